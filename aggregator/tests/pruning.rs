//! An aggregator that prunes when a round has closed: what goes, what stays, and what happens to requests and downloads meanwhile.
//!
//! An operator has accepted proofs of nothing in the rounds before, so that there are updates that audits read.

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io::Read;
use std::path::Path;
use std::sync::Arc;
use tempfile::TempDir;
use tonic::Code;
use zk0_aggregator::round::intake::group::ToRecord;
use zk0_aggregator::{Aggregator, Clock, Config, Polled, RoundJob, RoundStep};
use zk0_audit::{Auditor, Depth};
use zk0_ledger::blobs::Blobs;
use zk0_ledger::prune::{Longer, PrunePlan, Retention};
use zk0_ledger::published::mirror::mirror;
use zk0_ledger::published::publication::Publication;
use zk0_ledger::published::source::{LogSource, SourceError};
use zk0_ledger::replay::{replay, Verdict};
use zk0_ledger::{folder, Ledger};
use zk0_protocol::entries::authentic::AuthenticBody;
use zk0_protocol::entries::genesis::Genesis;
use zk0_protocol::entries::signed::{Dispute, Evidence, Signed, UpdateCommitment};
use zk0_protocol::rpc::federation as proto;
use zk0_protocol::rules::network_rules::{Scaffold, Strategy};
use zk0_protocol::tlog::layout::Resource;
use zk0_protocol::Body;
use zk0_testkit::aggregator::operator::Operator;
use zk0_testkit::aggregator::*;
use zk0_testkit::until_async;
use zk0_verifier::blob_digest;

/// Rounds open although nobody takes part in them.
pub const CONFIG: Config = Config {
    rounds: None,
    min_nodes: 0,
};

/// The update of node 1 in a round.
pub fn update(round: u32) -> Vec<u8> {
    weights(100 + round)
}

/// The proof in a round.
pub fn proof(round: u32) -> Vec<u8> {
    vec![b'p', round as u8]
}

/// A file that no entry names.
pub const UNNAMED: &[u8] = b"about to be named";

/// Closed rounds of node 1. None of their contributions can be disputed any more.
pub fn rounds(dir: &Path, genesis: Genesis, rounds: u32) -> Operator {
    let node = SigningNode::new(1);
    let mut operator = Operator::founds(dir, genesis, &[&node]);
    operator.ledger.blobs().put(UNNAMED).unwrap();
    for round in 0..rounds {
        operator.open();
        let submission = operator.submission_of(&node, &update(round), &proof(round));
        operator.append(Body::ContributionAccepted(submission));
        operator.close(200 + round);
        operator.time_ms += 2_000;
    }
    operator
}

/// A served ledger of closed rounds, of which the updates of the last `keep` are kept.
async fn served(closed: u32, keep: u64) -> Network {
    let dir = tempfile::tempdir().unwrap();
    let operator = rounds(dir.path(), genesis(), closed);
    let mut network = Network::of_operator(dir, operator, CONFIG);
    network.keep_rounds = Some(keep);
    network.start_again().await;
    network
}

/// Lets the open round end without a contribution.
pub async fn close(network: &Network) {
    network.settle().await;
    let round = network.round(None).await;
    assert!(round.opened.is_some() && round.closed.is_none());
    let closings = async || {
        let entries = network.entries().await.into_iter();
        let closings = entries.filter(|entry| matches!(entry.body, Body::RoundClosed(_)));
        closings.count()
    };
    let before = closings().await;
    network.clock.advance(COMMIT_MS + 1);
    until_async("the round closes", async || {
        network.settle().await;
        closings().await > before
    })
    .await;
}

fn blobs(network: &Network) -> Blobs {
    Blobs::at(network.dir.path())
}

/// Waits until the update of a round is gone.
async fn gone(network: &Network, round: u32) {
    let (blobs, blob) = (blobs(network), blob_digest(&update(round)));
    let is_gone = async || !blobs.is_here(&blob);
    until_async(format!("the update of round {round} goes"), is_gone).await;
}

/// The rounds up to 9 whose updates are there.
fn updates(dir: &Path) -> Vec<u32> {
    let blobs = Blobs::at(dir);
    let there = |round: &u32| blobs.is_here(&blob_digest(&update(*round)));
    (0..10).filter(there).collect()
}

fn names(dir: &Path) -> BTreeSet<String> {
    let files = fs::read_dir(dir.join("blobs/sha256")).unwrap();
    files
        .map(|file| file.unwrap().file_name().into_string().unwrap())
        .collect()
}

const fn keep(rounds: u64) -> Retention {
    Retention {
        rounds: Some(rounds),
        without_proofs: false,
        without_weights: false,
        checkpoint_interval: None,
    }
}

/// What a full audit states, and its verdict.
fn audited(dir: &Path) -> (Vec<String>, Verdict) {
    let report = replay(dir, None, &mut Auditor::new(Depth::Full));
    let findings = report.findings.into_iter();
    let findings = findings.map(|finding| finding.text).collect();
    (findings, report.verdict)
}

#[tokio::test(flavor = "multi_thread")]
async fn old_updates_go_when_a_round_has_closed_as_the_command_deletes_them() {
    let mut network = served(3, 2).await;
    let before = copy_of(&network.dir.path().join("blobs"));
    assert_eq!(updates(network.dir.path()), [0, 1, 2]);
    close(&network).await;
    gone(&network, 1).await;
    close(&network).await;
    gone(&network, 2).await;
    network.stop().await;
    let dir = network.dir.path();
    assert_eq!(updates(dir), [] as [u32; 0]);
    for kept in [proof(0), weights(200), UNNAMED.to_vec()] {
        assert!(Blobs::at(dir).is_here(&blob_digest(&kept)));
    }

    // The same ledger, of which nothing was pruned before the command.
    let other = copy_of(dir);
    let folder = other.path().join("blobs/sha256");
    for file in fs::read_dir(before.path().join("sha256")).unwrap() {
        let file = file.unwrap();
        fs::copy(file.path(), folder.join(file.file_name())).unwrap();
    }
    fs::remove_file(folder::pruned(other.path())).unwrap();
    let ledger = Ledger::open(other.path(), None, log_key()).unwrap();
    let plan = PrunePlan::of(&ledger, &keep(2), network.clock.now_ms()).unwrap();
    plan.carry_out(&ledger).unwrap();
    drop(ledger);
    let mut both = names(dir);
    assert!(both.remove(&blob_digest(UNNAMED).to_string()));
    assert_eq!(both, names(other.path()));
    let statement = |dir: &Path| fs::read(folder::pruned(dir)).unwrap();
    assert_eq!(statement(dir), statement(other.path()));
    let (findings, verdict) = audited(dir);
    let pruned = "has pruned the updates of rounds 0 to 2 (signed";
    let reports = findings.iter().any(|finding| finding.contains(pruned));
    assert!(reports, "{findings:?}");
    assert_eq!((findings, verdict), audited(other.path()));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_ledger_whose_refused_updates_went_still_verifies() {
    let (mut network, first, second) = open_round().await;
    network.keep_rounds = Some(1);
    network.restart().await;
    let update = both_committed(&network, &first, &second).await;
    for node in [&first, &second] {
        let claim = node.claim(&network).await;
        node.submit(&network, claim, b"no proof").await.unwrap();
    }
    network.settle().await;
    let (blobs, update) = (blobs(&network), blob_digest(&update));
    until_async("the update goes", async || !blobs.is_here(&update)).await;
    refused(
        network.download(update).await,
        Code::NotFound,
        "was pruned, or is lost",
    );
    network.stop().await;
    assert!(!folder::pruned(network.dir.path()).exists());
    let (findings, verdict) = audited(network.dir.path());
    assert_eq!(verdict, Verdict::Verified, "{findings:?}");
}

/// A contribution whose time for disputes is over, and about which a vote is still to decide.
#[tokio::test(flavor = "multi_thread")]
async fn a_contribution_under_dispute_keeps_its_files() {
    let dir = tempfile::tempdir().unwrap();
    let mut founded = genesis();
    founded.rules.credits.dispute_window_ms = 100_000;
    let mut operator = rounds(dir.path(), founded, 3);
    let (contribution, until_ms) = {
        let contributions = operator.state().contributions().iter();
        let mut of_second = contributions.filter(|(_, one)| one.round == 1);
        let (entry, one) = of_second.next().unwrap();
        (*entry, one.disputable_until_ms)
    };
    operator.time_ms = until_ms - 10_000;
    let disputer = SigningNode::new(GOVERNOR);
    let dispute = Dispute {
        network: *operator.state().network(),
        disputer: disputer.id(),
        contribution,
        evidence: Evidence::Document(blob_digest(b"a document")),
    };
    operator.append(Body::Disputed(Signed::new(dispute, &disputer.key)));
    let mut network = Network::of_operator(dir, operator, CONFIG);
    network.keep_rounds = Some(1);
    network.start_again().await;
    close(&network).await;
    gone(&network, 0).await;
    let of_now = network.service().with(move |aggregator| {
        let now_ms = aggregator.now_ms();
        let plan = aggregator.prunable().plan(&keep(1), now_ms)?;
        assert!(aggregator.state().contributions()[&contribution].disputable_until_ms < now_ms);
        Ok((plan.first_kept, plan.longer))
    });
    assert_eq!(of_now.await.unwrap(), (1, Some(Longer::Disputable(1))));
    network.stop().await;
    assert_eq!(updates(network.dir.path()), [1, 2]);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_download_in_progress_gets_the_rest_of_a_pruned_file() {
    let network = served(2, 1).await;
    let blob = blob_digest(&update(0));
    // The server does not verify it.
    let file = File::options()
        .write(true)
        .open(blobs(&network).path(&blob));
    file.unwrap().set_len(LONG_BYTES).unwrap();
    let request = proto::DownloadRequest {
        blob: blob.0.to_vec(),
        begins: 0,
    };
    let mut reader = network.slow_reader().await;
    let mut parts = reader.download(request).await.unwrap().into_inner();
    let first = parts.message().await.unwrap().unwrap();
    close(&network).await;
    gone(&network, 0).await;
    let mut held = first.data.len() as u64;
    while let Some(part) = parts.message().await.unwrap() {
        held += part.data.len() as u64;
    }
    assert_eq!(held, LONG_BYTES);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_failure_does_not_stop_the_rounds_and_the_next_end_tries_again() {
    let network = served(2, 1).await;
    // A folder in place of the statement can be neither read nor replaced.
    let statement = folder::pruned(network.dir.path());
    fs::create_dir(&statement).unwrap();
    close(&network).await;
    close(&network).await;
    assert_eq!(updates(network.dir.path()), [0, 1]);
    fs::remove_dir(&statement).unwrap();
    close(&network).await;
    gone(&network, 0).await;
    gone(&network, 1).await;
    assert!(statement.is_file());
    assert!(network.service().troubles().all().is_empty());
}

/// An aggregator of three closed rounds, whose fourth is open, and its clock.
fn opened() -> (TempDir, Aggregator, Arc<ManualClock>) {
    let dir = tempfile::tempdir().unwrap();
    let operator = rounds(dir.path(), genesis(), 3);
    let clock = Arc::new(ManualClock::at(operator.time_ms));
    drop(operator);
    let mut aggregator =
        Aggregator::open(dir.path(), None, log_key(), clock.clone(), CONFIG).unwrap();
    let open = Polled::Did(RoundStep::Open(3));
    assert_eq!(aggregator.go_on().unwrap(), open);
    (dir, aggregator, clock)
}

/// What a plan of the running aggregator deletes.
fn planned(aggregator: &Aggregator) -> PrunePlan {
    let plan = aggregator.prunable().plan(&keep(1), aggregator.now_ms());
    plan.unwrap().beside_writer()
}

/// Node 1 commits to the update of round 0 once more.
fn commitment() -> Signed<UpdateCommitment> {
    let node = SigningNode::new(1);
    let statement = node.commitment(&genesis().network_id(), 3, &update(0));
    Signed::new(statement, &node.key)
}

/// Uploads the update of round 0 once more.
fn upload(aggregator: &Aggregator) {
    let (node, update) = (SigningNode::new(1), update(0));
    let request = node.upload_request(&genesis().network_id(), 3, &update);
    let request = borsh::to_vec(&Signed::new(request, &node.key)).unwrap();
    let mut writer = aggregator.upload(&request).unwrap().unwrap();
    writer.write(&update).unwrap();
    writer.finish().unwrap();
}

#[test]
fn what_is_named_once_more_is_not_deleted() {
    let (_dir, mut aggregator, _) = opened();
    let mut plan = planned(&aggregator);
    let again = blob_digest(&update(0));
    let doomed: Vec<_> = plan.doomed.iter().map(|blob| blob.digest).collect();
    assert!(doomed.contains(&again) && doomed.len() == 2);
    upload(&aggregator);
    aggregator
        .commit(&borsh::to_vec(&commitment()).unwrap())
        .unwrap();
    let freed = aggregator.doom(&mut plan).unwrap().carry_out().unwrap();
    assert_eq!(freed.blobs, 1);
    assert!(aggregator.ledger().blobs().is_here(&again));
}

#[test]
fn nothing_is_recorded_that_names_a_deleted_file() {
    let (_dir, mut aggregator, _) = opened();
    let body = AuthenticBody::of(Body::UpdateCommitted(commitment())).unwrap();
    let statement = ToRecord::Statement(Box::new(body));
    let refused = |aggregator: &Aggregator| {
        let refused = aggregator.not_kept(&statement);
        refused.map(|refused| refused.to_string())
    };
    assert_eq!(refused(&aggregator), None);
    let mut plan = planned(&aggregator);
    let part = aggregator.doom(&mut plan).unwrap();
    assert!(plan.doomed.is_empty());
    let reported = refused(&aggregator).expect("it is being deleted");
    assert!(reported.contains("send it again"), "{reported}");
    part.carry_out().unwrap();
    aggregator.deleted();
    assert!(refused(&aggregator).is_some());
    upload(&aggregator);
    aggregator
        .commit(&borsh::to_vec(&commitment()).unwrap())
        .unwrap();
    assert_eq!(refused(&aggregator), None);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_node_that_sends_a_file_which_is_being_deleted_sends_it_again() {
    let network = served(3, 9).await;
    network.settle().await;
    let node = SigningNode::new(1);
    let dooming = network.service().with(|aggregator| {
        let mut plan = planned(aggregator);
        aggregator.doom(&mut plan)
    });
    let part = dooming.await.unwrap();
    let update = update(0);
    node.upload(&network, 3, &update).await.unwrap();
    refused(
        node.commit(&network, 3, &update).await,
        Code::Unavailable,
        "send it again",
    );
    part.carry_out().unwrap();
    let deleted = network.service().with(|aggregator| {
        aggregator.deleted();
        Ok(())
    });
    deleted.await.unwrap();
    node.commit(&network, 3, &update).await.unwrap();
    assert_eq!(
        network.download(blob_digest(&update)).await.unwrap(),
        update
    );
}

#[test]
fn a_round_ends_when_nothing_is_being_deleted() {
    let (_dir, mut aggregator, clock) = opened();
    let mut plan = planned(&aggregator);
    let part = aggregator.doom(&mut plan).unwrap();
    clock.advance(COMMIT_MS + 1);
    let mut polled = aggregator.go_on().unwrap();
    while let Polled::Did(step) = polled {
        assert_ne!(step, RoundStep::Close(3));
        polled = aggregator.go_on().unwrap();
    }
    assert_eq!(polled, Polled::Idle(None));
    part.carry_out().unwrap();
    aggregator.deleted();
    let closing = aggregator.step().unwrap();
    assert!(matches!(closing, Polled::Run(RoundJob::ComputeClosing(_))));
}

#[test]
fn a_request_in_progress_counts_as_of_its_arrival() {
    let (_dir, aggregator, clock) = opened();
    let arrivals = aggregator.arrivals().clone();
    let begun = arrivals.earliest_ms().unwrap();
    let arrival = arrivals.stamp().unwrap();
    clock.advance(5);
    assert_eq!(arrivals.earliest_ms().unwrap(), begun);
    drop(arrival);
    assert_eq!(arrivals.earliest_ms().unwrap(), begun + 5);
}

#[test]
fn updates_are_deleted_in_parts_and_the_statement_comes_first() {
    let (dir, aggregator, _) = opened();
    let mut plan = planned(&aggregator);
    let whole = plan.doomed.len();
    let first = plan.part(1);
    assert!(first.statement.is_some() && plan.statement.is_none());
    assert_eq!((first.doomed.len(), plan.doomed.len()), (1, whole - 1));
    first.signed(aggregator.ledger()).carry_out().unwrap();
    assert!(folder::pruned(dir.path()).is_file());
    let rest = plan.part(100).signed(aggregator.ledger());
    assert_eq!(rest.carry_out().unwrap().blobs, whole as u64 - 1);
    assert_eq!(updates(dir.path()), [2]);
}

/// A log that prunes when somebody asks for the first blob.
struct PrunesMeanwhile<'a> {
    view: Publication,
    prune: RefCell<Option<Box<dyn FnOnce() + 'a>>>,
}

impl LogSource for PrunesMeanwhile<'_> {
    fn open(&self, path: &str) -> Result<Option<Box<dyn Read>>, SourceError> {
        if let Some(Resource::Blob(_)) = Resource::parse(path) {
            if let Some(prune) = self.prune.take() {
                prune();
            }
        }
        LogSource::open(&self.view, path)
    }
}

#[test]
fn a_mirror_gets_the_statement_about_what_was_pruned_meanwhile() {
    let dir = tempfile::tempdir().unwrap();
    let operator = rounds(dir.path(), genesis(), 3);
    let (ledger, now_ms) = (&operator.ledger, operator.time_ms);
    let plan = PrunePlan::of(ledger, &keep(1), now_ms).unwrap();
    let prune = || plan.carry_out(ledger).unwrap();
    let log = PrunesMeanwhile {
        view: Publication::open(dir.path(), None).unwrap(),
        prune: RefCell::new(Some(Box::new(prune))),
    };
    let out = tempfile::tempdir().unwrap();
    let done = mirror(&log, out.path(), None, None).unwrap();
    assert_eq!(done.missing_blobs, 2);
    let statement = |dir: &Path| fs::read(folder::pruned(dir)).unwrap();
    assert_eq!(statement(out.path()), statement(dir.path()));
}

#[test]
fn rounds_stay_from_which_scaffold_computes() {
    let dir = tempfile::tempdir().unwrap();
    let mut founded = genesis();
    founded.rules.strategy = Strategy::Scaffold(Scaffold {
        steps: 10,
        learning_rate_millionths: 1000,
        restart_rounds: 3,
    });
    for (closed, first) in [(5, (3, Some(Longer::ControlVariates(3)))), (6, (5, None))] {
        let dir = dir.path().join(closed.to_string());
        let operator = rounds(&dir, founded.clone(), closed);
        let plan = PrunePlan::of(&operator.ledger, &keep(1), operator.time_ms).unwrap();
        assert_eq!((plan.first_kept, plan.longer), first);
    }
}
