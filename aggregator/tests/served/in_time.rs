//! A request is judged by when it arrived, and nobody waits while the aggregator verifies something.

use crate::Test;
use std::fs::{self, File};
use std::io::Write;
use std::path::PathBuf;
use std::process::Command;
use std::time::Duration;
use tokio::task::spawn_blocking;
use tokio::time::timeout;
use tonic::{Code, Streaming};
use zk0_circuits::Claim;
use zk0_protocol::entries::entry::Body;
use zk0_protocol::rpc::federation as proto;
use zk0_protocol::RefusalCode;
use zk0_testkit::aggregator::*;
use zk0_testkit::network::log_keys::later_key;
use zk0_testkit::until_async;
use zk0_verifier::blob_digest;

const SOON: Duration = Duration::from_secs(10);
const A_MOMENT: Duration = Duration::from_millis(100);

/// A network in which the first node has committed to an update, and its claim. Reading the update takes until the test lets go of it.
async fn with_a_slow_update() -> (Network, SigningNode, Claim, SlowFile) {
    let (network, first, _) = open_round().await;
    let update = committed(&network, &first, 0, 1).await;
    let claim = first.claim(&network).await;
    let blobs = network.dir.path().join("blobs/sha256");
    let slow = SlowFile::instead_of(blobs.join(blob_digest(&update).to_string()));
    (network, first, claim, slow)
}

/// A named pipe in place of a file: whoever reads it waits.
struct SlowFile {
    path: PathBuf,
    content: Vec<u8>,
}

/// Somebody waits for the content of such a file.
struct Reader {
    pipe: File,
    content: Vec<u8>,
}

impl SlowFile {
    fn instead_of(path: PathBuf) -> Self {
        let content = fs::read(&path).unwrap();
        fs::remove_file(&path).unwrap();
        let made = Command::new("mkfifo").arg(&path).status().unwrap();
        assert!(made.success());
        Self { path, content }
    }

    /// Waits until somebody reads the pipe.
    async fn reader(self) -> Reader {
        let opened = spawn_blocking(|| File::options().write(true).open(self.path));
        let pipe = timeout(SOON, opened).await.expect("nobody reads it");
        Reader {
            pipe: pipe.unwrap().unwrap(),
            content: self.content,
        }
    }
}

impl Reader {
    /// Lets them read the pipe to its end.
    async fn let_go(mut self) {
        let written = spawn_blocking(move || self.pipe.write_all(&self.content));
        written.await.unwrap().unwrap();
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_service_answers_while_it_verifies_a_submission() -> Test {
    let (network, first, claim, slow) = with_a_slow_update().await;
    let network = std::sync::Arc::new(network);
    let submitting = {
        let network = network.clone();
        tokio::spawn(async move { first.submit(&network, claim, b"no proof").await })
    };
    let reader = slow.reader().await;
    assert!(!submitting.is_finished());
    timeout(SOON, network.round(None)).await?;
    timeout(SOON, network.entries()).await?;
    reader.let_go().await;
    let reply = timeout(SOON, submitting).await???;
    assert!(
        reason(&reply).contains("not an SP1 compressed proof"),
        "{}",
        reason(&reply)
    );
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_submission_that_arrived_in_time_is_not_late_however_long_it_takes() -> Test {
    let (network, first, claim, slow) = with_a_slow_update().await;
    let network = std::sync::Arc::new(network);
    network.clock.advance(SUBMIT_MS);
    let submitting = {
        let network = network.clone();
        tokio::spawn(async move { first.submit(&network, claim, b"no proof").await })
    };
    let reader = slow.reader().await;
    network.clock.advance(60_000);
    // The round waits for it.
    network.settle().await;
    assert_eq!(network.round(Some(0)).await.closed, None);
    reader.let_go().await;
    let reply = timeout(SOON, submitting).await???;
    assert!(
        reason(&reply).contains("not an SP1 compressed proof"),
        "{}",
        reason(&reply)
    );
    network.settle().await;
    assert!(network.round(Some(0)).await.closed.is_some());
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn what_arrives_late_waits_for_what_arrived_in_time() -> Test {
    let (network, first, second) = open_round().await;
    both_committed(&network, &first, &second).await;
    let (early, late) = (first.claim(&network).await, second.claim(&network).await);
    let blobs = network.dir.path().join("blobs/sha256");
    let slow = SlowFile::instead_of(blobs.join(blob_digest(&weights(1)).to_string()));
    let network = std::sync::Arc::new(network);
    let submitting = |node: SigningNode, claim: Claim| {
        let network = network.clone();
        tokio::spawn(async move { node.submit(&network, claim, b"no proof").await })
    };
    let early = submitting(first, early);
    let reader = slow.reader().await;
    network.clock.advance(SUBMIT_MS + 5);
    let mut late = submitting(second, late);
    network.in_progress("Submit", 2).await;
    let waits = timeout(A_MOMENT, &mut late).await;
    assert!(waits.is_err(), "{waits:?}");
    reader.let_go().await;
    let early = timeout(SOON, early).await???;
    let late = timeout(SOON, late).await???;
    assert!(
        reason(&early).contains("not an SP1 compressed proof"),
        "{}",
        reason(&early)
    );
    let (_, _, entry) = network.opened(late.receipt.ok_or("no receipt")?);
    let Body::ContributionRejected { reason, .. } = entry.body else {
        panic!("{entry:?}");
    };
    assert!(
        matches!(reason, RefusalCode::Late { late_ms: 5, .. }),
        "{reason}"
    );
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_late_request_does_not_hold_up_an_earlier_one_of_its_node() -> Test {
    let mut genesis = genesis();
    genesis.rules.max_proof_bytes = 2_000_000;
    let (network, first, second) = open_round_of(genesis).await;
    both_committed(&network, &first, &second).await;
    let claim = first.claim(&network).await;
    network.clock.advance(SUBMIT_MS);
    let service = network.service().clone();
    let arrivals = service.with(|aggregator| Ok(aggregator.arrivals().clone()));
    let arrivals = arrivals.await?;
    // Both requests are begun while nobody can have the aggregator.
    let (let_go, held) = std::sync::mpsc::channel::<()>();
    let holding = tokio::spawn(async move {
        let hold = move |_: &mut zk0_aggregator::Aggregator| {
            held.recv().unwrap();
            Ok(())
        };
        service.with(hold).await
    });
    let network = std::sync::Arc::new(network);
    let submitting = |proof: Vec<u8>| {
        let (network, claim) = (network.clone(), claim.clone());
        tokio::spawn(async move { SigningNode::new(1).submit(&network, claim, &proof).await })
    };
    // The proof of the earlier one takes longer to hash, so that the late one is the first to ask for the turn of their node.
    let early = submitting(vec![1; 2_000_000]);
    let arrived = async || arrivals.any_by(u64::MAX);
    until_async("the earlier one arrives", arrived).await;
    network.clock.advance(5);
    let late = submitting(vec![2]);
    network.in_progress("Submit", 2).await;
    tokio::time::sleep(A_MOMENT).await;
    let_go.send(())?;
    timeout(SOON, holding).await???;
    let early = timeout(SOON, early).await???;
    let reason = reason(&early);
    assert!(reason.contains("not an SP1 compressed proof"), "{reason}");
    refused(timeout(SOON, late).await??, Code::AlreadyExists, "already");
    network.settle().await;
    assert!(network.round(Some(0)).await.closed.is_some());
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_submission_of_an_earlier_round_is_turned_away_before_its_signature_is_verified() -> Test
{
    let (network, first, _) = open_round().await;
    committed(&network, &first, 0, 1).await;
    let claim = first.claim(&network).await;
    let mut submission = first.submission(claim, b"no proof");
    network.clock.advance(SUBMIT_MS + 1);
    network.settle().await;
    submission.signature[0] ^= 1;
    refused(
        first
            .submit_as(&network, &submission, b"another proof")
            .await,
        Code::FailedPrecondition,
        "round 0",
    );
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_submission_that_comes_several_times_at_once_is_decided_once() -> Test {
    let (network, first, second) = open_round().await;
    both_committed(&network, &first, &second).await;
    let claim = first.claim(&network).await;
    let before = network.entries().await.len();
    let submission = first.submission(claim, b"no proof");
    let all = (0..8).map(|_| first.submit_as(&network, &submission, b"no proof"));
    let mut receipts = Vec::new();
    for reply in futures_all(all.collect()).await {
        receipts.push(reply?.receipt.ok_or("no receipt")?);
    }
    assert!(receipts.iter().all(|receipt| *receipt == receipts[0]));
    assert_eq!(network.entries().await.len(), before + 1);
    Ok(())
}

/// The outputs of futures that run together.
async fn futures_all<F: std::future::Future>(all: Vec<F>) -> Vec<F::Output> {
    let mut all: Vec<_> = all.into_iter().map(|one| (Box::pin(one), None)).collect();
    std::future::poll_fn(|context| {
        for (future, output) in &mut all {
            if output.is_none() {
                if let std::task::Poll::Ready(done) = future.as_mut().poll(context) {
                    *output = Some(done);
                }
            }
        }
        match all.iter().all(|(_, output)| output.is_some()) {
            true => std::task::Poll::Ready(()),
            false => std::task::Poll::Pending,
        }
    })
    .await;
    all.into_iter().filter_map(|(_, output)| output).collect()
}

async fn told(stream: &mut Streaming<proto::RoundInfo>) -> proto::RoundInfo {
    timeout(SOON, stream.message())
        .await
        .expect("the node is told in time")
        .unwrap()
        .expect("the stream goes on")
}

#[tokio::test(flavor = "multi_thread")]
async fn a_node_is_told_when_its_round_has_come_further() -> Test {
    let (network, first, second) = open_round().await;
    let request = proto::GetRoundRequest {
        round: Some(0),
        node: first.id().0.to_vec(),
    };
    let mut stream = network
        .client()
        .await
        .watch_round(request)
        .await?
        .into_inner();
    let round = told(&mut stream).await;
    assert!(round.invited && round.opened.is_some() && round.commitments_closed.is_none());
    // Entries that take the round no further are no news.
    both_committed(&network, &first, &second).await;
    network.settle().await;
    let mut round = told(&mut stream).await;
    if round.randomness.is_none() {
        round = told(&mut stream).await;
    }
    assert!(round.commitments_closed.is_some() && round.randomness.is_some());
    network.clock.advance(SUBMIT_MS + 1);
    network.settle().await;
    let round = told(&mut stream).await;
    assert!(round.closed.is_some());
    let silent = timeout(A_MOMENT, stream.message()).await;
    assert!(silent.is_err(), "{silent:?}");
    Ok(())
}

/// Otherwise the round would close at the start, and count against nodes that could reach nobody.
#[tokio::test(flavor = "multi_thread")]
async fn a_deadline_that_passed_while_the_aggregator_was_away_moves() -> Test {
    let (mut network, first, second) = open_round().await;
    both_committed(&network, &first, &second).await;
    network.drawn().await;
    network.stop().await;
    network.clock.advance(SUBMIT_MS + 1);
    network.start_again().await;
    let Body::DeadlinesMoved(moved) = network.last().await else {
        panic!("the deadline has not moved");
    };
    assert!(moved.by_ms > SUBMIT_MS, "{moved:?}");
    network.settle().await;
    assert!(network.round(Some(0)).await.closed.is_none());
    let claim = first.claim(&network).await;
    let decided = first.submit(&network, claim, b"no proof").await?;
    let (_, _, entry) = network.opened(decided.receipt.unwrap());
    let Body::ContributionRejected { reason, .. } = entry.body else {
        panic!("it is not refused");
    };
    assert!(!matches!(reason, RefusalCode::Late { .. }), "{reason}");
    // A restart within the window moves nothing.
    let entries = network.entries().await;
    network.restart().await;
    assert_eq!(network.entries().await, entries);
    // The window is as long as it was.
    network.clock.advance(SUBMIT_MS + 1);
    network.settle().await;
    assert!(network.round(Some(0)).await.closed.is_some());
    Ok(())
}

/// The key was stolen, and the operator replaces it while no aggregator runs.
#[tokio::test(flavor = "multi_thread")]
async fn a_deadline_moves_although_the_log_got_another_key_in_the_outage() -> Test {
    let (mut network, first, second) = open_round().await;
    both_committed(&network, &first, &second).await;
    network.drawn().await;
    network.stop().await;
    network.clock.advance(SUBMIT_MS + 1);
    network.rotate_log_key(later_key(1)).await;
    let mut bodies = network
        .entries()
        .await
        .into_iter()
        .rev()
        .map(|one| one.body);
    let Some(Body::DeadlinesMoved(moved)) = bodies.next() else {
        panic!("the deadline has not moved");
    };
    assert!(matches!(bodies.next(), Some(Body::LogKeyRotated { .. })));
    assert!(moved.by_ms > SUBMIT_MS, "{moved:?}");
    network.settle().await;
    assert!(network.round(Some(0)).await.closed.is_none());
    Ok(())
}
