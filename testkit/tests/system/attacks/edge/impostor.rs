//! Row 17. Somebody between a node and its aggregator answers in its place, with a certificate for the right address that an authority of its own
//! has signed. It hands on all that it hears, so that nobody notices, and reads everything.

use crate::attacks::attack::{over_the_network, Attack, Defence, Outcome, Proof};
use std::fs;
use std::path::Path;
use std::sync::Arc;
use tokio::net::TcpListener;
use zk0_aggregator::Config;
use zk0_node::client;
use zk0_service::tls::local_authority::{LocalAuthority, CA, CERTIFICATE, KEY};
use zk0_service::tls::server_certificate::ServerCertificate;
use zk0_service::tls::service_address::ServiceAddress;
use zk0_testkit::aggregator::{Network, SigningNode};
use zk0_testkit::changed_copy::SourceChange;

pub const ATTACK: Attack = Attack {
    number: 17,
    name: "an impostor with another certificate stands between a node and its aggregator",
    module: module_path!(),
    reason: "its certificate is not signed by a certificate in",
    proof: Proof::NotNeeded,
    defence: Defence {
        check: "a node believes the authorities that its operator named, and no others",
        out: &[SourceChange {
            file: "service/src/tls/authorities.rs",
            replacements: &[(
                "            Some(path) => read(path).map_err(",
                "            Some(path) => read(&match OUT {
                true => path.with_file_name(\"impostor.pem\"),
                false => path.clone(),
            })
            .map_err(",
            )],
        }],
    },
    carry_out: || over_the_network(carry_out()),
};

/// A certificate for loopback, of an authority that was just made.
fn authority(dir: &Path) -> Arc<ServerCertificate> {
    let authority = LocalAuthority::new(&["127.0.0.1".into()]).unwrap();
    authority.write(dir).unwrap();
    ServerCertificate::load(&dir.join(CERTIFICATE), &dir.join(KEY)).unwrap()
}

async fn carry_out() -> Outcome {
    let node = SigningNode::new(1);
    let config = Config {
        rounds: Some(1),
        min_nodes: 1,
    };
    let network = Network::start(&[&node], config).await;
    let [named, others] = [0, 1].map(|_| tempfile::tempdir().unwrap());
    authority(named.path());
    let impostor = network
        .service()
        .clone()
        .encrypted(authority(others.path()));
    // Where no authority is checked, the node believes this one.
    fs::copy(others.path().join(CA), named.path().join("impostor.pem")).unwrap();
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let url = format!("https://{}", listener.local_addr().unwrap());
    let serving = tokio::spawn(impostor.serve(listener, std::future::pending()));
    let address = ServiceAddress::from(url).with_ca(Some(named.path().join(CA)));
    let connected = client::NodeClient::connect(address, network.genesis.network_id(), node.key);
    let connected = connected.await;
    serving.abort();
    match connected {
        Ok(_) => {
            Outcome::Succeeded("the node speaks to the impostor, which reads everything".into())
        }
        Err(error) => Outcome::Refused(error.to_string()),
    }
}

#[test]
fn it_is_refused() {
    ATTACK.is_refused();
}
