//! Row 16. Strangers hold requests on all connections of the service, and open silent ones again and again. So the one newcomer whose
//! request is still on its way looks idle.

use super::crowds::{is_answered, with_places};
use crate::attacks::attack::{over_the_network, Attack, Defence, Outcome, Proof};
use std::net::{IpAddr, SocketAddr};
use std::time::Duration;
use tokio::io::copy_bidirectional;
use tokio::net::{TcpListener, TcpSocket};
use tokio::time::{sleep, timeout};
use zk0_protocol::rpc::federation::GetNetworkRequest;
use zk0_testkit::aggregator::SigningNode;
use zk0_testkit::changed_copy::SourceChange;
use zk0_testkit::sockets::{begin_large_message, from};
use zk0_testkit::until_async;

pub const ATTACK: Attack = Attack {
    number: 16,
    name: "strangers hold requests on all connections of the service, and open silent ones again and again",
    module: module_path!(),
    reason: "a node and a newcomer were answered beside 15 connections with requests",
    proof: Proof::NotNeeded,
    defence: Defence {
        check: "a connection makes room whose network holds most, and no newcomer before its first request",
        out: &[SourceChange {
            file: "aggregator/src/connections/crowds.rs",
            replacements: &[
                (
                    "(crowd.len() + usize::from(its_own)).max(FEW)",
                    "if OUT { FEW } else { (crowd.len() + usize::from(its_own)).max(FEW) }",
                ),
                (
                    "if now.saturating_duration_since(self.came) < GRACE {",
                    "if !OUT && now.saturating_duration_since(self.came) < GRACE {",
                ),
            ],
        }],
    },
    carry_out: || over_the_network(carry_out()),
};

const PLACES: usize = 16;
/// How many connections had to make room.
const MADE_ROOM: &str = r#"zk0_connections_lost_total{limit="made-room"}"#;
/// How often the attacker opens a silent connection.
const CHURN: Duration = Duration::from_millis(30);
/// How long the newcomer's first bytes are on their way.
const ON_THE_WAY: Duration = Duration::from_millis(400);
/// How long a newcomer tries.
const PATIENCE: Duration = Duration::from_secs(15);

/// Relays one connection after the other from an address of its own to the aggregator at `url`, and is slow with what the client states
/// first. Returns its own URL.
async fn far_away(url: &str) -> String {
    let aggregator: SocketAddr = url.strip_prefix("http://").unwrap().parse().unwrap();
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let url = format!("http://{}", listener.local_addr().unwrap());
    tokio::spawn(async move {
        while let Ok((mut client, _)) = listener.accept().await {
            let socket = TcpSocket::new_v4().unwrap();
            let own = IpAddr::from([127, 0, 2, 1]);
            socket.bind((own, 0).into()).unwrap();
            let Ok(mut server) = socket.connect(aggregator).await else {
                continue;
            };
            sleep(ON_THE_WAY).await;
            let _ = copy_bidirectional(&mut client, &mut server).await;
        }
    });
    url
}

async fn carry_out() -> Outcome {
    let node = SigningNode::new(1);
    let network = with_places(&node, PLACES).await;
    // Its network has few connections, so it keeps its place.
    let mut member = network.client().await;
    let registration = node.registration(&network.genesis.network_id());
    let request = node.registering(&network, &registration, node.list());
    member.record(request).await.unwrap();
    let mut holding = Vec::new();
    for host in 1..PLACES as u8 {
        // From addresses of their own, so that no limit of an address stops them.
        let mut stream = from([1, host], &network.address).await;
        begin_large_message(&mut stream).await;
        holding.push(stream);
        network.in_progress("Record", host.into()).await;
    }
    let url = network.address.clone();
    let churning = tokio::spawn(async move {
        let mut silent = Vec::new();
        for host in (100..200).cycle() {
            silent.push(from([1, host], &url).await);
            sleep(CHURN).await;
        }
    });
    let made_room = async || network.metric(MADE_ROOM) > 0;
    until_async("a connection makes room", made_room).await;
    let newcomer = is_answered(far_away(&network.address).await, PATIENCE).await;
    let asked = timeout(PATIENCE, member.get_network(GetNetworkRequest {})).await;
    let member = asked.is_ok_and(|answer| answer.is_ok());
    churning.abort();
    let held = holding.len();
    assert!(member, "a node that was there has lost its place");
    match newcomer {
        true => Outcome::Refused(format!(
            "a node and a newcomer were answered beside {held} connections with requests"
        )),
        false => Outcome::Succeeded(format!(
            "{held} connections with requests, and silent ones that come and go, keep newcomers out"
        )),
    }
}

#[test]
fn it_is_refused() {
    ATTACK.is_refused();
}
