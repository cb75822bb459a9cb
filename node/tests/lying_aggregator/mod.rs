//! A node believes nothing that an aggregator states of a round's randomness or of a proposal. The aggregator of these tests holds the log's
//! key, and shows the node whatever a test makes up.

mod asking_again;
mod former_key;
mod lying;
mod other_program;
mod proof_in_time;

use lying::Lying;
use std::fs;
use std::sync::atomic::AtomicUsize;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::task::JoinHandle;
use tokio::time::timeout;
use tokio_stream::wrappers::TcpListenerStream;
use tonic::transport::Server;
use tonic::Status;
use zk0_node::client::NodeClient;
use zk0_node::client_error::NodeError;
use zk0_node::error::ParticipantError;
use zk0_node::receipts;
use zk0_node::recording::registering::Registering;
use zk0_node::recording::OpenRecording;
use zk0_node::turn::{Entered, Turn};
use zk0_protocol::challenge::closing;
use zk0_protocol::challenge::drand::DrandChain;
use zk0_protocol::challenge::drawing::{Drawing, RandomnessError};
use zk0_protocol::challenge::source::RandomnessSource;
use zk0_protocol::challenge::vrf::VrfProof;
use zk0_protocol::entries::entry::{RandomnessDrawn, RoundOpened};
use zk0_protocol::entries::program::Program;
use zk0_protocol::entries::proposal::{Action, Ballot};
use zk0_protocol::rpc::federation as rpc;
use zk0_protocol::rpc::federation::federation_server::FederationServer;
use zk0_protocol::rpc::PROTOCOL;
use zk0_protocol::tlog::key_rotation::LogKeyRotation;
use zk0_protocol::{Body, Entry, Receipt, Signed, TlogProof};
use zk0_testkit::micro_network::{pickplace, Setting};
use zk0_testkit::network::log::{MemoryLog, ORIGIN};
use zk0_testkit::network::log_keys::*;
use zk0_testkit::network::*;
use zk0_weights::Format;

/// A ledger in memory, with one round in it.
struct Told {
    chain: Chain,
    leaves: Vec<Vec<u8>>,
    opened: RoundOpened,
    /// The entry that closed the commitments.
    closing: u64,
    /// The entry that gave the log its later key, if it has one.
    later_since: Option<u64>,
    /// The network of the operator's statement about the later key.
    key_network: zk0_circuits::Digest,
    /// Whether the receipts have the founding key's signature even so.
    by_thief: bool,
    /// The program in force, if the aggregator names another one than the round's.
    in_force: Option<Program>,
    /// How often a node began to follow the round.
    follows: Arc<AtomicUsize>,
}

impl Told {
    /// A network in which node 0 has committed and the commitments are closed.
    fn new() -> Self {
        let mut chain = Chain::new();
        let genesis = entry(T0, Body::Genesis(genesis())).encode().unwrap();
        let mut leaves = vec![genesis];
        let mut apply = |chain: &mut Chain, body: Body| {
            chain.apply(body.clone());
            leaves.push(entry(chain.time_ms, body).encode().unwrap());
        };
        apply(&mut chain, enrolled(0));
        let network = *chain.state.network();
        apply(&mut chain, registered(&network, 0));
        let opened = opened(&chain.state, chain.time_ms + 1);
        apply(&mut chain, Body::RoundOpened(opened.clone()));
        let commitment = committed(&chain.state, 0, weights(0x10));
        apply(&mut chain, commitment);
        let closing = chain.state.entries();
        let closed = commitments_closed(&chain.state);
        apply(&mut chain, Body::CommitmentsClosed(closed));
        Self {
            chain,
            leaves,
            opened,
            closing,
            later_since: None,
            key_network: network,
            by_thief: false,
            in_force: None,
            follows: Arc::default(),
        }
    }

    /// The checkpoint of the first `size` entries, signed with the log's key.
    fn checkpoint(&self, size: u64) -> Vec<u8> {
        let checkpoint = MemoryLog::of(&self.leaves[..size as usize]).checkpoint(size);
        let Some(entry) = self.later_since.filter(|entry| *entry < size) else {
            return checkpoint.sign(ORIGIN, &log_key()).unwrap();
        };
        let rotation = LogKeyRotation {
            entry,
            network: self.key_network,
            ..log_rotation(&self.chain.state, &later_key(1))
        };
        let rotation = Signed::new(rotation, &log_key());
        let text = checkpoint.sign_after(ORIGIN, &later_key(1), Some(&rotation));
        text.unwrap()
    }

    /// Records what the rules may forbid.
    fn record(&mut self, body: Body) -> u64 {
        self.chain.time_ms += 1;
        let entry = entry(self.chain.time_ms, body);
        self.leaves.push(entry.encode().unwrap());
        self.leaves.len() as u64 - 1
    }

    /// The receipt of an entry in the tree of the first `size` entries.
    fn receipt(&self, index: u64, size: u64) -> Option<rpc::Receipt> {
        let mut receipt: Receipt = MemoryLog::of(&self.leaves[..size as usize]).receipt(index);
        if !self.by_thief {
            receipt.checkpoint = self.checkpoint(size);
        }
        Some(receipt.into())
    }

    fn round(&self, randomness: Option<u64>) -> rpc::RoundInfo {
        let all = self.leaves.len() as u64;
        rpc::RoundInfo {
            commitments_closed: self.receipt(self.closing, self.closing + 1),
            randomness: randomness.and_then(|index| self.receipt(index, all)),
            ..rpc::RoundInfo::default()
        }
    }

    /// The governance with every recorded proposal, as if all were open.
    fn governance(&self) -> rpc::GovernanceInfo {
        let all = self.leaves.len() as u64;
        let proposed = |index: &u64| {
            let entry = Entry::decode(&self.leaves[*index as usize]).unwrap();
            matches!(entry.body, Body::Proposed(_))
        };
        let open = |index| rpc::OpenProposal {
            receipt: self.receipt(index, all),
            ..rpc::OpenProposal::default()
        };
        rpc::GovernanceInfo {
            rules: borsh::to_vec(self.chain.state.rules()).unwrap(),
            program: borsh::to_vec(self.chain.state.program()).unwrap(),
            proposals: (0..all).filter(proposed).map(open).collect(),
            ..rpc::GovernanceInfo::default()
        }
    }

    /// Node 0, connected to an aggregator that shows it this round, and the aggregator.
    async fn connected(&self, round: rpc::RoundInfo) -> (NodeClient, JoinHandle<()>) {
        self.failing(round, Failures::default()).await
    }

    /// The same. The aggregator fails like this, the last failure first, before it shows the round or the governance.
    async fn failing(
        &self,
        round: rpc::RoundInfo,
        failures: Failures,
    ) -> (NodeClient, JoinHandle<()>) {
        let (url, server) = self.served(round, failures, PROTOCOL).await;
        let network = *self.chain.state.network();
        let node = NodeClient::connect(url, network, key(0)).await.unwrap();
        (node, server)
    }

    /// The address of an aggregator that shows this round, and the aggregator.
    async fn served(
        &self,
        round: rpc::RoundInfo,
        failures: Failures,
        protocol: u32,
    ) -> (String, JoinHandle<()>) {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let url = format!("http://{}", listener.local_addr().unwrap());
        let checkpoint = self.checkpoint(self.leaves.len() as u64);
        let in_force = self.in_force.as_ref();
        let lying = Lying {
            genesis: self.leaves[0].clone(),
            checkpoint: String::from_utf8(checkpoint).unwrap(),
            round,
            in_force: in_force.map(|program| borsh::to_vec(program).unwrap()),
            follows: self.follows.clone(),
            governance: self.governance(),
            failures,
            protocol,
        };
        let serving = Server::builder()
            .add_service(FederationServer::new(lying))
            .serve_with_incoming(TcpListenerStream::new(listener));
        let server = tokio::spawn(async move { serving.await.unwrap() });
        (url, server)
    }

    /// The challenge that node 0 derives from what it is shown, or why it derives none.
    async fn shown(
        &self,
        round: rpc::RoundInfo,
        opened: &RoundOpened,
    ) -> Result<zk0_circuits::Digest, NodeError> {
        let (mut node, server) = self.connected(round).await;
        let statement = commitment(&self.chain.state, 0, weights(0x10));
        let commitment = closing::commitment(&statement);
        let challenge = node.wait_for_challenge(opened, &commitment).await;
        server.abort();
        challenge.map(|(challenge, _)| challenge)
    }
}

/// Failures that an aggregator has before it.
type Failures = Arc<Mutex<Vec<Status>>>;

fn wrong(result: Result<zk0_circuits::Digest, NodeError>) -> RandomnessError {
    match result {
        Err(NodeError::Randomness { error, .. }) => error,
        other => panic!("{other:?}"),
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_challenge_is_the_one_that_the_ledger_expects() {
    let mut told = Told::new();
    let drawing = Body::RandomnessDrawn(drawn(&told.chain.state));
    told.chain.apply(drawing.clone());
    told.chain.time_ms -= 1;
    let index = told.record(drawing);
    let challenge = told.shown(told.round(Some(index)), &told.opened).await;
    let expected = told.chain.state.expected_claim(&id(0)).unwrap();
    assert_eq!(challenge.unwrap(), expected.terms.challenge);
}

#[tokio::test(flavor = "multi_thread")]
async fn randomness_that_somebody_chose_is_no_randomness() {
    let commitments = commitments_closed(&Told::new().chain.state).commitments;
    for proof in [
        VrfProof::of(&key(0), &commitments.0),
        VrfProof::of(&log_key(), &digest(1).0),
    ] {
        let mut told = Told::new();
        let drawing = Drawing::LogVrf(proof);
        let index = told.record(Body::RandomnessDrawn(RandomnessDrawn { round: 0, drawing }));
        let error = wrong(told.shown(told.round(Some(index)), &told.opened).await);
        assert_eq!(error, RandomnessError::Vrf(commitments));
    }
    // The rules ask for a beacon, and the aggregator takes its own key.
    let mut told = Told::new();
    let index = told.record(Body::RandomnessDrawn(drawn(&told.chain.state)));
    let mut opened = told.opened.clone();
    opened.rules.randomness = RandomnessSource::Drand(Box::new(DrandChain::quicknet()));
    let error = wrong(told.shown(told.round(Some(index)), &opened).await);
    assert!(matches!(error, RandomnessError::OtherSource { .. }));
}

#[tokio::test(flavor = "multi_thread")]
async fn other_entries_are_not_taken_for_the_closing_or_the_randomness() {
    let mut told = Told::new();
    let index = told.record(Body::RandomnessDrawn(drawn(&told.chain.state)));
    let all = told.leaves.len() as u64;
    let right = told.round(Some(index));
    let other_closing = rpc::RoundInfo {
        commitments_closed: told.receipt(1, 2),
        ..right.clone()
    };
    // The closing with a checkpoint of a later tree, of which witnesses would sign something else.
    let later = rpc::RoundInfo {
        commitments_closed: told.receipt(told.closing, all),
        ..right.clone()
    };
    let other_randomness = rpc::RoundInfo {
        randomness: told.receipt(2, all),
        ..right
    };
    for round in [other_closing, later, other_randomness] {
        let refused = told.shown(round, &told.opened).await;
        assert!(
            matches!(refused, Err(NodeError::Unexpected { .. })),
            "{refused:?}"
        );
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_round_that_closed_without_randomness_is_over_for_the_node() {
    let told = Told::new();
    let round = rpc::RoundInfo {
        closed: told.receipt(told.closing, told.closing + 1),
        ..told.round(None)
    };
    let over = told.shown(round, &told.opened).await;
    assert!(
        matches!(over, Err(NodeError::NoRandomness { round: 0 })),
        "{over:?}"
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_node_that_the_rules_leave_out_waits_before_it_trains() {
    let told = Told::new();
    for (invited, round, begins) in [(false, 0, false), (true, 1, false), (true, 0, true)] {
        // Entry 3 opened the round.
        let info = rpc::RoundInfo {
            opened: told.receipt(3, 4),
            program: borsh::to_vec(told.chain.state.program()).unwrap(),
            invited,
            ..rpc::RoundInfo::default()
        };
        let (mut node, server) = told.connected(info).await;
        // A busy machine may be slow to answer. Who gets no answer is not waited for as long.
        let patience = Duration::from_secs(if begins { 20 } else { 2 });
        let waited = timeout(patience, node.wait_for_round(round)).await;
        server.abort();
        match begins {
            true => assert_eq!(waited.unwrap().unwrap().opened, told.opened),
            false => assert!(waited.is_err(), "invited: {invited}, from round {round} on"),
        }
    }
}

/// A node computes its control variates for SCAFFOLD from its own accepted updates alone.
#[tokio::test(flavor = "multi_thread")]
async fn the_contribution_of_somebody_else_is_not_the_node_s_own() {
    let mut told = Told::new();
    let drawing = Body::RandomnessDrawn(drawn(&told.chain.state));
    told.chain.apply(drawing.clone());
    told.record(drawing);
    let right = submission(claim(&told.chain.state, 0), 0);
    let of = |change: fn(&mut zk0_circuits::Terms), key_number| {
        let mut claim = right.statement.claim.clone();
        change(&mut claim.terms);
        Body::ContributionAccepted(submission(claim, key_number))
    };
    let accepted = of(|_| {}, 0);
    let entries = [
        (accepted.clone(), true),
        // Another node's, another round's, another network's, and one that another node has signed.
        (of(|terms| terms.node = id(1), 1), false),
        (of(|terms| terms.round = 7, 0), false),
        (of(|terms| terms.network = digest(9), 0), false),
        (of(|_| {}, 1), false),
        (committed(&told.chain.state, 0, weights(0x10)), false),
    ];
    for (body, own) in entries {
        let index = told.record(body.clone());
        let all = told.leaves.len() as u64;
        let info = rpc::RoundInfo {
            contribution: told.receipt(index, all),
            ..rpc::RoundInfo::default()
        };
        let (mut node, server) = told.connected(info).await;
        let update = node.accepted_update(0).await;
        server.abort();
        match own {
            true => assert_eq!(update.unwrap(), right.statement.claim.terms.update),
            false => assert!(
                matches!(update, Err(NodeError::Unexpected { .. })),
                "{body:?}: {update:?}"
            ),
        }
    }
    let (mut node, server) = told.connected(rpc::RoundInfo::default()).await;
    let update = node.accepted_update(0).await;
    server.abort();
    assert!(
        matches!(update, Err(NodeError::Unexpected { .. })),
        "{update:?}"
    );
}

/// A vote is for what its proposer has signed. The aggregator alone cannot make that up.
#[tokio::test(flavor = "multi_thread")]
async fn a_proposal_that_its_proposer_has_not_signed_is_not_voted_on() {
    for (signer, signed) in [(0, true), (1, false)] {
        let mut told = Told::new();
        let proposal = votes::proposal(&told.chain.state, 0, Action::Suspend(id(1)));
        let by = governor_key(signer);
        told.record(Body::Proposed(Signed::new(proposal.clone(), &by)));
        let (mut node, server) = told.connected(rpc::RoundInfo::default()).await;
        let info = node.governance().await;
        match signed {
            true => {
                let info = info.unwrap();
                let (shown, _) = &info.proposals[0];
                assert_eq!(*shown, proposal);
                // The node votes on it, and asks this aggregator to record the vote.
                let asked = node.vote(shown, Ballot::For).await;
                assert!(matches!(asked, Err(NodeError::Refused(_))), "{asked:?}");
            }
            false => assert!(
                matches!(info, Err(NodeError::Unexpected { .. })),
                "{info:?}"
            ),
        }
        server.abort();
    }
}

/// The rules of the round that the aggregator shows allow weights of any size.
#[tokio::test(flavor = "multi_thread")]
async fn a_download_takes_no_more_memory_than_weights_of_the_network_do() {
    let told = Told::new();
    let setting = Setting::new();
    let recording = OpenRecording::open(&pickplace(), &setting.policy(), None).unwrap();
    let maker = recording.maker();
    let samples = recording.samples(&maker);
    let folder = tempfile::tempdir().unwrap();
    let registering = Registering {
        state: folder.path(),
        recording: &recording,
        samples: &samples,
        spec: &setting.spec,
    };
    let entered = Entered {
        config: recording.config(),
        format: Format::new(&setting.spec).unwrap(),
        samples: &samples,
        training: &samples,
        evaluation: setting.set(&recording, &samples, folder.path(), 20),
        registering: &registering,
    };
    let mut opened = told.opened.clone();
    opened.rules.max_update_bytes = u64::MAX;
    let turn = Turn {
        state: folder.path(),
        entered: &entered,
        opened: &opened,
        program: &Program::founding(&[2; 32]),
        eval_samples: 1,
    };
    let (mut node, server) = told.connected(rpc::RoundInfo::default()).await;
    let error = turn.base(&mut node).await.err();
    server.abort();
    let most = entered.format.file_bytes();
    assert!(
        matches!(
            error,
            Some(ParticipantError::Node(NodeError::TooLarge { limit, .. })) if limit == most
        ),
        "{error:?}"
    );
}

#[test]
fn both_proofs_of_a_fork_are_kept() {
    let dir = tempfile::tempdir().unwrap();
    let keep = |log: &MemoryLog| receipts::keep(dir.path(), &genesis(), log.receipt(3));
    keep(&MemoryLog::of_enrolments(4, 1)).unwrap();
    // The same entry in a larger tree is no fork.
    let newer = MemoryLog::of_enrolments(6, 1);
    keep(&newer).unwrap();
    let forked = MemoryLog::of_enrolments(6, 2);
    for _ in ["first", "after a restart"] {
        let error = keep(&forked).unwrap_err();
        assert!(
            matches!(error, ParticipantError::Forked { index: 3, .. }),
            "{error}"
        );
    }
    let found = fs::read_dir(dir.path().join("receipts")).unwrap();
    let mut found: Vec<_> = found
        .map(|file| fs::read(file.unwrap().path()).unwrap())
        .collect();
    let mut both = [&newer, &forked].map(|log| TlogProof::from(log.receipt(3)).encode());
    found.sort();
    both.sort();
    assert_eq!(found, both);
}
