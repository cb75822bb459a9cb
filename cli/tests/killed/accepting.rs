//! The aggregator is killed (SIGKILL) at each step of accepting a contribution, and started again with the same command. The contribution is
//! accepted exactly once, its node always gets the same receipt, and the round closes with it.

use super::relay::Relay;
use crate::harness::process::Process;
use crate::harness::recorded::{Member, Recorded};
use crate::harness::zk0;
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;
use tempfile::TempDir;
use tokio::runtime::Runtime;
use tokio::task::JoinHandle;
use zk0_circuits::{Digest, NodeId};
use zk0_node::client::watching::Waited;
use zk0_node::client::{NodeClient, SubmissionDecision};
use zk0_node::client_error::NodeError;
use zk0_protocol::entries::entry::{Body, Entry, RoundClosed};
use zk0_protocol::Receipt;
use zk0_testkit::own_port::OwnPort;
use zk0_testkit::s3::S3;

/// The recorded network, served by a real process behind a relay.
pub(super) struct Served {
    pub(super) recorded: Recorded,
    pub(super) members: Arc<Vec<Member>>,
    pub(super) dir: TempDir,
    aggregator: Process,
    /// Where the aggregator listens, and goes on listening when it is started again.
    port: OwnPort,
    relay: Relay,
    /// Where its entries and blobs are, besides the folder. Then each kill loses the folder, too.
    bucket: Option<S3>,
    pub(super) runtime: Runtime,
}

impl Served {
    pub(super) fn start() -> Self {
        Self::start_in(None)
    }

    pub(super) fn start_in(bucket: Option<S3>) -> Self {
        let recorded = Recorded::read();
        let dir = tempfile::tempdir().unwrap();
        recorded.found(dir.path());
        let members = Arc::new(recorded.members());
        let port = OwnPort::take();
        let count = members.len();
        let aggregator = serving(
            &recorded,
            dir.path(),
            &port.address(),
            count,
            bucket.as_ref(),
        );
        aggregator.reports("the aggregator of network");
        Self {
            bucket,
            relay: Relay::to(&port.address()),
            recorded,
            members,
            dir,
            aggregator,
            port,
            runtime: Runtime::new().unwrap(),
        }
    }

    /// Kills the aggregator, if it runs, and starts it again. With a bucket, that is on another machine, with an empty folder.
    pub(super) fn restart(&mut self) {
        self.aggregator.kill();
        self.relay.let_through();
        if self.bucket.is_some() {
            self.dir = tempfile::tempdir().unwrap();
        }
        let (dir, listen) = (self.dir.path(), self.port.address());
        let count = self.members.len();
        self.aggregator = serving(&self.recorded, dir, &listen, count, self.bucket.as_ref());
        self.aggregator.reports("the aggregator of network");
    }

    fn network(&self) -> Digest {
        self.recorded.genesis().network_id()
    }

    /// The client of a member, behind the relay.
    pub(super) async fn client(&self, member: &Member) -> NodeClient {
        let (url, key) = (self.relay.url.clone(), self.recorded.key(member));
        let client = NodeClient::connect(url, self.network(), key);
        client.await.unwrap()
    }

    /// Lets each member play its part in round 0.
    fn play(&self) -> Vec<JoinHandle<SubmissionDecision>> {
        let members = 0..self.members.len();
        let played = members.map(|number| {
            let (members, url) = (self.members.clone(), self.relay.url.clone());
            let (network, key) = (self.network(), self.recorded.key(&members[number]));
            self.runtime.spawn(async move {
                let mut node = NodeClient::connect(url, network, key).await.unwrap();
                part(&members[number], &mut node).await
            })
        });
        played.collect()
    }

    /// Submits again what a member has submitted.
    fn again(&self, member: &Member) -> SubmissionDecision {
        self.runtime.block_on(async {
            let mut node = self.client(member).await;
            let claim = member.submission.claim.clone();
            node.submit(claim, member.proof.clone()).await.unwrap()
        })
    }

    /// How the round has closed, as a node learns it.
    fn closed(&self) -> RoundClosed {
        self.runtime.block_on(async {
            let mut node = self.client(&self.members[0]).await;
            let mut watch = node.until_closed(0);
            match node.wait_for_close(&mut watch).await.unwrap() {
                Waited::Closed(closed) => *closed,
                Waited::Lost => panic!("a file is lost"),
            }
        })
    }

    /// The entries on disk, when the process has ended.
    fn entries(&self) -> Vec<Entry> {
        self.recorded.entries_of(self.dir.path())
    }
}

fn serving(
    recorded: &Recorded,
    dir: &Path,
    listen: &str,
    nodes: usize,
    bucket: Option<&S3>,
) -> Process {
    let (dir, key) = (dir.to_str().unwrap(), recorded.log_key());
    let (key, nodes) = (key.to_str().unwrap(), nodes.to_string());
    let words = ["aggregator", "serve", dir, "--key", key, "--listen", listen];
    let mut command = zk0(&["--log", "json"]);
    command
        .args(words)
        .args(["--rounds", "1", "--min-nodes", &nodes]);
    if let Some(bucket) = bucket {
        command.args(["--blob-store", &bucket.address("net")]);
        command.envs(bucket.variables());
    }
    Process::of(command)
}

/// A member's part in round 0, with the proof that it once made.
pub(super) async fn part(member: &Member, node: &mut NodeClient) -> SubmissionDecision {
    until_submission(member, node).await;
    let claim = member.submission.claim.clone();
    node.submit(claim, member.proof.clone()).await.unwrap()
}

/// A member's part in round 0, as far as its submission.
pub(super) async fn until_submission(member: &Member, node: &mut NodeClient) {
    let (registration, leaves) = (member.registration.clone(), member.leaves.clone());
    node.register(registration, leaves).await.unwrap();
    let opened = node.wait_for_round(0).await.unwrap().opened;
    node.upload(0, member.update.clone()).await.unwrap();
    let mut committed = commit(member, node).await;
    // With its machine, an aggregator loses what was uploaded and not committed to.
    if committed.as_ref().is_err_and(NodeError::lacks_update) {
        node.upload(0, member.update.clone()).await.unwrap();
        committed = commit(member, node).await;
    }
    let (commitment, _) = committed.unwrap();
    let (challenge, _) = node.wait_for_challenge(&opened, &commitment).await.unwrap();
    // Otherwise the proof would be of another claim.
    assert_eq!(challenge, member.submission.claim.terms.challenge);
}

async fn commit(member: &Member, node: &mut NodeClient) -> Result<(Digest, Receipt), NodeError> {
    let reported = &member.commitment;
    let committed = node.commit(
        0,
        &reported.dataset_root,
        &reported.update,
        reported.eval_samples,
    );
    committed.await
}

/// Whose submissions are decided by these entries.
fn decided(entries: &[Entry]) -> Vec<(NodeId, bool)> {
    let decisions = entries.iter().filter_map(|entry| match &entry.body {
        Body::ContributionAccepted(signed) => Some((signed, true)),
        Body::ContributionRejected { submission, .. } => Some((submission, false)),
        _ => None,
    });
    let whose = decisions.map(|(signed, accepted)| (signed.statement.claim.terms.node, accepted));
    whose.collect()
}

fn closings(entries: &[Entry]) -> Vec<&RoundClosed> {
    let closings = entries.iter().filter_map(|entry| match &entry.body {
        Body::RoundClosed(closed) => Some(closed),
        _ => None,
    });
    closings.collect()
}

impl Served {
    /// Waits for the end of the round, and checks that it is what was recorded, once and for all.
    fn ends(mut self, played: Vec<JoinHandle<SubmissionDecision>>) {
        let decisions: Vec<_> = played
            .into_iter()
            .map(|played| self.runtime.block_on(played).unwrap())
            .collect();
        let closed = self.closed();
        let members = self.members.clone();
        let accepted = members.iter().filter(|member| member.accepted);
        let accepted: BTreeSet<_> = accepted.map(|member| member.id).collect();
        assert!(!accepted.is_empty());
        let contributors = closed.contributors.iter().map(|one| one.node);
        assert_eq!(contributors.collect::<BTreeSet<_>>(), accepted);
        // The weights are those of the recorded round, bit for bit.
        assert_eq!(closed.global, self.recorded.closed().global);
        for restarted in [false, true] {
            for (member, decision) in members.iter().zip(&decisions) {
                assert_eq!(decision.refusal.is_none(), member.accepted);
                assert_eq!(self.again(member).receipt, decision.receipt, "{restarted}");
            }
            self.restart();
        }
        self.aggregator.terminate();
        let entries = self.entries();
        let mut once: Vec<_> = members.iter().map(|one| (one.id, one.accepted)).collect();
        let mut found = decided(&entries);
        once.sort();
        found.sort();
        assert_eq!(found, once);
        assert_eq!(closings(&entries), [&closed]);
    }
}

impl Served {
    /// Kills the aggregator as soon as its log has stated `step` so often, and checks that the round ends as it was recorded.
    pub(super) fn goes_on(mut self, step: &str, times: usize) {
        let played = self.play();
        for _ in 0..times {
            self.aggregator.reports(step);
        }
        self.restart();
        self.ends(played);
    }
}

fn goes_on(step: &str, times: usize) {
    Served::start().goes_on(step, times);
}

/// Tries it until the aggregator is killed at the right moment, which is a short one: `right` states it of the entries on disk and of what nodes wait
/// for.
fn at_the_moment(
    kill: impl Fn(&mut Served),
    right: impl Fn(&Served, &[Entry], &[JoinHandle<SubmissionDecision>]) -> bool,
) {
    for _ in 0..10 {
        let mut served = Served::start();
        let played = served.play();
        kill(&mut served);
        served.aggregator.kill();
        if right(&served, &served.entries(), &played) {
            served.restart();
            return served.ends(played);
        }
        played.iter().for_each(JoinHandle::abort);
    }
    panic!("the aggregator was never killed at the right moment");
}

#[test]
fn the_aggregator_is_killed_when_an_update_is_uploaded() {
    goes_on("update uploaded", 1);
}

#[test]
fn the_aggregator_is_killed_when_an_update_is_committed() {
    goes_on("update committed", 1);
}

#[test]
fn the_aggregator_is_killed_when_the_commitments_are_closed() {
    goes_on("commitments closed", 1);
}

#[test]
fn the_aggregator_is_killed_when_the_randomness_is_drawn() {
    goes_on("randomness drawn", 1);
}

#[test]
fn the_aggregator_is_killed_when_a_submission_has_arrived_and_is_not_recorded() {
    at_the_moment(
        |served| drop(served.aggregator.reports("submission arrived")),
        |_, entries, _| decided(entries).is_empty(),
    );
}

#[test]
fn the_aggregator_is_killed_when_a_contribution_is_recorded_and_not_acknowledged() {
    at_the_moment(
        |served| {
            // Answers that are held back before a claim that counts has arrived would keep it from arriving.
            let accepted = served.members.iter().filter(|member| member.accepted);
            let accepted: Vec<_> = accepted.map(|member| member.id.to_string()).collect();
            let counts = |line: Value| accepted.iter().any(|id| line["node"] == **id);
            while !counts(served.aggregator.reports("submission arrived")) {}
            served.relay.hold();
            served.aggregator.reports("contribution accepted");
        },
        |served, entries, played| {
            let recorded = decided(entries);
            let mut parts = served.members.iter().zip(played);
            parts.any(|(member, part)| recorded.contains(&(member.id, true)) && !part.is_finished())
        },
    );
}

#[test]
fn the_aggregator_is_killed_when_all_is_decided_and_the_round_closes() {
    at_the_moment(
        |served| {
            for _ in 0..served.members.len() {
                served.aggregator.reports("contribution ");
            }
        },
        |_, entries, _| closings(entries).is_empty(),
    );
}

#[test]
fn the_aggregator_is_killed_when_the_round_has_closed() {
    goes_on("round closed", 1);
}
