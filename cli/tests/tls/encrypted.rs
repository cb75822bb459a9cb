//! A network whose aggregator runs in the test, with a certificate or without.

use crate::harness::network::LocalNetwork;
use std::path::{Path, PathBuf};
use std::sync::mpsc::Receiver;
use std::sync::Arc;
use std::time::Duration;
use tempfile::TempDir;
use tokio::net::TcpListener;
use tokio::task::JoinHandle;
use zk0::keys;
use zk0_aggregator::{Aggregator, Config, ConnectionLimits, Limits, Service, SystemClock};
use zk0_circuits::Digest;
use zk0_node::client::NodeClient;
use zk0_node::client_error::NodeError;
use zk0_service::tls::local_authority::{LocalAuthority, CA, CERTIFICATE, KEY};
use zk0_service::tls::server_certificate::ServerCertificate;
use zk0_service::tls::service_address::ServiceAddress;

/// How long a handshake may take.
pub const HANDSHAKE: Duration = Duration::from_secs(4);

/// A running aggregator.
pub struct Encrypted {
    local: LocalNetwork,
    network: Digest,
    /// Host and port.
    pub address: String,
    service: Service,
    running: JoinHandle<()>,
}

impl Drop for Encrypted {
    fn drop(&mut self) {
        self.running.abort();
    }
}

impl Encrypted {
    /// Founds a network, and serves it. A handshake has [`HANDSHAKE`].
    pub async fn serve(certificate: Option<Arc<ServerCertificate>>) -> Self {
        let local = LocalNetwork::new();
        local.found(&[]);
        let key = keys::read(Path::new(&local.path("log.key"))).unwrap();
        let (ledger, clock) = (local.path("ledger"), Arc::new(SystemClock));
        let config = Config {
            rounds: None,
            min_nodes: 1,
        };
        let aggregator = Aggregator::open(Path::new(&ledger), None, key, clock, config).unwrap();
        let network = *aggregator.state().network();
        let limits = Limits {
            connections: ConnectionLimits {
                handshake: HANDSHAKE,
                ..ConnectionLimits::default()
            },
            ..Limits::default()
        };
        let mut service = Service::with_limits(aggregator, limits);
        if let Some(certificate) = certificate {
            service = service.encrypted(certificate);
        }
        let running = service.clone();
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap().to_string();
        let running = tokio::spawn(async move {
            let served = running.serve(listener, std::future::pending()).await;
            served.unwrap();
        });
        Self {
            local,
            network,
            address,
            service,
            running,
        }
    }

    /// Lets the aggregator answer nobody until the other end of `released` sends, or is dropped.
    pub fn busy_until(&self, released: Receiver<()>) -> JoinHandle<()> {
        let service = self.service.clone();
        tokio::spawn(async move {
            let work = move |_: &mut Aggregator| {
                let _ = released.recv();
                Ok(())
            };
            service.with(work).await.unwrap();
        })
    }

    /// Connects to the aggregator by `scheme` as a node that believes the authorities in `ca`.
    pub async fn connect(
        &self,
        scheme: &str,
        ca: Option<PathBuf>,
    ) -> Result<NodeClient, NodeError> {
        let url = format!("{scheme}://{}", self.address);
        let address = ServiceAddress::from(url).with_ca(ca);
        let key = keys::read(Path::new(&self.local.path("node.key"))).unwrap();
        NodeClient::connect(address, self.network, key).await
    }

    /// Why a node that believes the authorities in `ca` cannot connect.
    pub async fn refused(&self, scheme: &str, ca: Option<PathBuf>) -> String {
        match self.connect(scheme, ca).await {
            Ok(_) => panic!("the node is connected"),
            Err(error) => error.to_string(),
        }
    }
}

/// A folder with an authority, and with a certificate that it has signed.
pub struct Certificates(TempDir);

impl Certificates {
    /// A certificate for the aggregator of a test.
    pub fn new() -> Self {
        Self::of(&LocalAuthority::new(&["127.0.0.1".into()]).unwrap())
    }

    pub fn of(authority: &LocalAuthority) -> Self {
        let dir = tempfile::tempdir().unwrap();
        authority.write(dir.path()).unwrap();
        Self(dir)
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub fn ca(&self) -> Option<PathBuf> {
        Some(self.path(CA))
    }

    /// The server's certificate.
    pub fn load(&self) -> Arc<ServerCertificate> {
        ServerCertificate::load(&self.path(CERTIFICATE), &self.path(KEY)).unwrap()
    }
}
