//! A node that lacks the program in force neither trains nor ends.

use super::Told;
use std::sync::atomic::Ordering;
use std::time::Duration;
use tokio::time::timeout;
use zk0_node::client::carried::carried;
use zk0_protocol::entries::program::Program;
use zk0_protocol::rpc::federation as rpc;
use zk0_testkit::network::genesis;

#[tokio::test(flavor = "multi_thread")]
async fn a_node_waits_while_it_lacks_the_program_in_force() {
    let told = Told::new();
    let own = carried(genesis().mode).remove(0);
    let of_other_sp1 = Program {
        sp1: "9.9.9".into(),
        ..own.clone()
    };
    let other = Program::founding(&[2; 32]);
    for (program, carries) in [(other, false), (of_other_sp1, false), (own, true)] {
        // Entry 3 opened the round.
        let info = rpc::RoundInfo {
            opened: told.receipt(3, 4),
            program: borsh::to_vec(&program).unwrap(),
            invited: true,
            ..rpc::RoundInfo::default()
        };
        let (mut node, server) = told.connected(info).await;
        // A busy machine may be slow to answer. Who gets no answer is not waited for as long.
        let patience = Duration::from_secs(if carries { 20 } else { 2 });
        let begins = timeout(patience, node.wait_for_provable_round(0)).await;
        let starts = timeout(patience, node.wait_for_program()).await;
        server.abort();
        if carries {
            assert_eq!(begins.unwrap().unwrap().opened, told.opened);
            starts.unwrap().unwrap();
        } else {
            assert!(begins.is_err() && starts.is_err(), "{program}");
        }
    }
}

/// The aggregator names one program for the open round, and another one as that in force.
#[tokio::test(flavor = "multi_thread")]
async fn a_node_that_is_told_two_programs_asks_less_and_less_often() {
    let own = carried(genesis().mode).remove(0);
    let told = Told {
        in_force: Some(own),
        ..Told::new()
    };
    let info = rpc::RoundInfo {
        opened: told.receipt(3, 4),
        program: borsh::to_vec(&Program::founding(&[2; 32])).unwrap(),
        invited: true,
        ..rpc::RoundInfo::default()
    };
    let (mut node, server) = told.connected(info).await;
    let patience = Duration::from_secs(3);
    let begins = timeout(patience, node.wait_for_provable_round(0)).await;
    server.abort();
    assert!(begins.is_err());
    // The first waits are half a second, three quarters, and longer.
    let follows = told.follows.load(Ordering::Relaxed);
    assert!(follows <= 4, "{follows}");
}
