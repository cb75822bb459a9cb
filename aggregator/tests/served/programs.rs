//! Another guest program, and the weights of an earlier round, by vote.

use super::verified_again;
use crate::Test;
use std::fs;
use std::path::Path;
use std::sync::Arc;
use tonic::{Code, Status};
use zk0_aggregator::{Aggregator, Config, Polled, RoundStep};
use zk0_protocol::entries::entry::Body;
use zk0_protocol::entries::genesis::Genesis;
use zk0_protocol::entries::program::Program;
use zk0_protocol::entries::proposal::{Action, Ballot};
use zk0_protocol::entries::signed::Signed;
use zk0_protocol::rpc::federation as proto;
use zk0_protocol::RefusalCode;
use zk0_testkit::aggregator::operator::{proposed, voted, Operator};
use zk0_testkit::aggregator::real_proof::real_proof;
use zk0_testkit::aggregator::*;
use zk0_verifier::blob_digest;

const CONFIG: Config = Config {
    rounds: None,
    min_nodes: 1,
};

/// A program whose release of SP1 nobody has.
fn of_another_release() -> Program {
    Program {
        sp1: "9.9.9".into(),
        ..Program::founding(&genesis().program)
    }
}

/// Opens the aggregator of a network of one node.
fn open(dir: &Path, clock: &Arc<ManualClock>) -> Aggregator {
    Aggregator::open(dir, None, log_key(), clock.clone(), CONFIG).unwrap()
}

/// Proposes, votes and settles, through the aggregator.
fn decide(aggregator: &mut Aggregator, clock: &ManualClock, action: Action) -> Test {
    let number = aggregator.state().next_proposal();
    let proposal = proposed(aggregator.state(), action);
    aggregator.tell(&borsh::to_vec(&proposal)?)?;
    let vote = voted(aggregator.state(), Ballot::For);
    aggregator.tell(&borsh::to_vec(&vote)?)?;
    clock.advance(VOTING_MS + 1);
    assert_eq!(aggregator.step()?, Polled::Did(RoundStep::Settle(number)));
    Ok(())
}

#[test]
fn no_round_opens_with_a_program_that_nobody_here_can_verify() -> Test {
    let (dir, node) = (tempfile::tempdir()?, SigningNode::new(1));
    let operator = Operator::founds(dir.path(), genesis(), &[&node]);
    let clock = Arc::new(ManualClock::at(operator.time_ms));
    drop(operator);
    let mut aggregator = open(dir.path(), &clock);
    decide(
        &mut aggregator,
        &clock,
        Action::ReplaceProgram(of_another_release()),
    )?;
    let Polled::Blocked(why) = aggregator.step()? else {
        panic!("the aggregator runs a round that it cannot verify");
    };
    assert!(
        why.contains("round 0 cannot open") && why.contains("SP1 9.9.9") && why.contains("6.10.0"),
        "{why}"
    );
    // The network is not lost: members can still put a program in force that can be verified.
    let founding = Program::founding(&genesis().program);
    decide(&mut aggregator, &clock, Action::ReplaceProgram(founding))?;
    assert_eq!(aggregator.step()?, Polled::Did(RoundStep::Open(0)));
    Ok(())
}

#[test]
fn an_open_round_that_nobody_here_can_verify_is_not_run() -> Test {
    let (dir, node) = (tempfile::tempdir()?, SigningNode::new(1));
    let mut operator = Operator::founds(dir.path(), genesis(), &[&node]);
    operator.decide(Action::ReplaceProgram(of_another_release()));
    operator.open();
    let clock = Arc::new(ManualClock::at(operator.time_ms));
    drop(operator);
    let error = Aggregator::open(dir.path(), None, log_key(), clock, CONFIG).err();
    let error = error.ok_or("opened")?.to_string();
    assert!(
        error.contains("round 0 is open") && error.contains("SP1 9.9.9"),
        "{error}"
    );
    Ok(())
}

#[test]
fn a_proof_of_the_program_before_is_refused() -> Test {
    let ((own, proof), node) = (real_proof(), SigningNode::new(1));
    let other = Program::founding(&[2; 32]);
    let mut genesis = genesis();
    genesis.rules.max_proof_bytes = 4 << 20;
    let submit = |first: &Program, then: &Program| -> Result<_, Box<dyn std::error::Error>> {
        let genesis = Genesis {
            program: first.key.clone(),
            ..genesis.clone()
        };
        let dir = tempfile::tempdir()?;
        let mut operator = Operator::founds(dir.path(), genesis, &[&node]);
        operator.decide(Action::ReplaceProgram(then.clone()));
        operator.open();
        let submission = operator.submission(&node, 1, &proof);
        let clock = Arc::new(ManualClock::at(operator.time_ms));
        drop(operator);
        let mut aggregator = open(dir.path(), &clock);
        let decided = aggregator.submit(&borsh::to_vec(&submission)?, proof.clone())?;
        Ok(decided.rejected.map(|refusal| refusal.code))
    };
    // The proof is of the first program, and another one is in force.
    assert_eq!(submit(&own, &other)?, Some(RefusalCode::OtherProgram));
    // The proof is of the program in force, and only its claim is another.
    assert_eq!(submit(&other, &own)?, Some(RefusalCode::OtherClaim));
    Ok(())
}

/// The aggregator knows the program of an earlier round whether or not it has been restarted since.
#[test]
fn a_dispute_is_decided_by_the_program_of_its_round() -> Test {
    let ((own, proof), node) = (real_proof(), SigningNode::new(1));
    let mut genesis = genesis();
    genesis.rules.max_proof_bytes = 4 << 20;
    genesis.rules.credits.dispute_window_ms = 10 * VOTING_MS;
    genesis.program = own.key;
    for restarted in [false, true] {
        let dir = tempfile::tempdir()?;
        let mut operator = Operator::founds(dir.path(), genesis.clone(), &[&node]);
        let accepted = operator.round(&node, 1, &proof);
        let clock = Arc::new(ManualClock::at(operator.time_ms));
        drop(operator);
        let mut aggregator = open(dir.path(), &clock);
        let other = Program::founding(&[2; 32]);
        decide(&mut aggregator, &clock, Action::ReplaceProgram(other))?;
        if restarted {
            drop(aggregator);
            aggregator = open(dir.path(), &clock);
        }
        // The proof is of the round's program, and only its claim is another.
        let upheld = verified_again(&mut aggregator, accepted)?;
        assert_eq!(upheld, Some(RefusalCode::OtherClaim));
    }
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn nodes_hear_which_program_a_round_is_of() -> Test {
    let (network, first, _) = open_round().await;
    let record = async |body: Body| -> Result<(), Status> {
        let request = network.recording(&body);
        network.client().await.record(request).await.map(drop)
    };
    let state = || async {
        let state = |aggregator: &mut Aggregator| Ok(aggregator.state().clone());
        network.service().with(state).await.unwrap()
    };
    let founding = Program::founding(&network.genesis.program);
    let no_program = Program {
        key: vec![0xff; 32],
        ..founding.clone()
    };
    let action = Action::ReplaceProgram(no_program);
    refused(
        record(proposed(&state().await, action)).await,
        Code::FailedPrecondition,
        "there is no such program",
    );
    refused(
        record(proposed(
            &state().await,
            Action::RestoreWeights { round: 0 },
        ))
        .await,
        Code::FailedPrecondition,
        "round 0 is still open",
    );
    // The round goes on.
    committed(&network, &first, 0, 1).await;
    let next = Program::founding(&[2; 32]);
    let action = Action::ReplaceProgram(next.clone());
    record(proposed(&state().await, action)).await?;
    record(voted(&state().await, Ballot::For)).await?;
    network.clock.advance(VOTING_MS + 1);
    network.settle().await;
    let reported = || async {
        let request = proto::GetGovernanceRequest {};
        let governance = network.client().await.get_governance(request).await;
        let governance = governance.unwrap().into_inner().program;
        assert_eq!(network.round(None).await.program, governance);
        borsh::from_slice::<Program>(&governance).unwrap()
    };
    // The vote is over, but round 0 keeps its program.
    assert!(network.round(None).await.closed.is_none());
    assert_eq!(reported().await, founding);
    network.drawn().await;
    network.clock.advance(SUBMIT_MS + 1);
    network.settle().await;
    assert_eq!(state().await.round().map(|round| round.number()), Some(1));
    assert_eq!(reported().await, next);
    Ok(())
}

#[test]
fn a_round_starts_from_restored_weights_once_their_blob_is_at_hand() -> Test {
    let (dir, node) = (tempfile::tempdir()?, SigningNode::new(1));
    let mut operator = Operator::founds(dir.path(), genesis(), &[&node]);
    operator.round(&node, 1, b"no proof");
    operator.round(&node, 2, b"no proof");
    let clock = Arc::new(ManualClock::at(operator.time_ms));
    drop(operator);
    let mut aggregator = open(dir.path(), &clock);
    let restore = || Action::RestoreWeights { round: 0 };
    let place = aggregator.ledger().blobs().path(&blob_digest(&weights(1)));
    // The blob is lost when somebody proposes to go back to it.
    fs::remove_file(&place)?;
    let proposal = borsh::to_vec(&proposed(aggregator.state(), restore()))?;
    let size = aggregator.ledger().size();
    let error = aggregator.tell(&proposal).unwrap_err().to_string();
    assert!(
        error.contains("does not have that blob any more"),
        "{error}"
    );
    assert_eq!(aggregator.ledger().size(), size);
    // The blob is lost after that.
    fs::write(&place, weights(1))?;
    decide(&mut aggregator, &clock, restore())?;
    fs::remove_file(&place)?;
    let Polled::Blocked(why) = aggregator.step()? else {
        panic!("a round starts from weights that nobody has");
    };
    assert!(
        why.contains("that blob is not in the ledger's folder"),
        "{why}"
    );
    fs::write(&place, weights(1))?;
    assert_eq!(aggregator.step()?, Polled::Did(RoundStep::Open(2)));
    let round = aggregator.state().round().ok_or("no round")?;
    assert_eq!(round.opened.base, digest(&weights(1)));
    // A node can train from the weights, and the round ends.
    assert!(aggregator.blob(&round.opened.base.blob).is_ok());
    let commitment = node.commitment(aggregator.state().network(), 2, &weights(3));
    let request = node.upload_request(aggregator.state().network(), 2, &weights(3));
    let request = borsh::to_vec(&Signed::new(request, &node.key))?;
    let mut writer = aggregator.upload(&request)?.ok_or("known")?;
    writer.write(&weights(3))?;
    writer.finish()?;
    aggregator.commit(&borsh::to_vec(&Signed::new(commitment, &node.key))?)?;
    assert_eq!(
        aggregator.step()?,
        Polled::Did(RoundStep::CloseCommitments(2))
    );
    assert_eq!(aggregator.step()?, Polled::Did(RoundStep::Draw(2)));
    clock.advance(SUBMIT_MS + 1);
    assert_eq!(aggregator.go_on()?, Polled::Did(RoundStep::Close(2)));
    assert_eq!(aggregator.state().global(), &digest(&weights(1)));
    Ok(())
}
