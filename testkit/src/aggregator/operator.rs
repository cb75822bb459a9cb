//! An operator with the log's key, restrained by the ledger's rules alone.

use super::{digest, log_key, weights, SigningNode, GOVERNOR, POLICY, START_MS, VOTING_MS};
use std::fs;
use std::path::Path;
use zk0_ledger::folder;
use zk0_ledger::log::Ledger;
use zk0_ledger::store::{Store, StoreBatch};
use zk0_protocol::challenge::drawing::Drawing;
use zk0_protocol::entries::entry::{
    Body, Entry, ProposalSettled, RandomnessDrawn, RoundClosed, ENTRY_VERSION,
};
use zk0_protocol::entries::genesis::Genesis;
use zk0_protocol::entries::member::NodeEnrolled;
use zk0_protocol::entries::proposal::{Action, Ballot, Outcome};
use zk0_protocol::entries::signed::{Proposal, Signed, Submission, Vote};
use zk0_protocol::rules::state::State;
use zk0_protocol::tlog::checkpoint::Checkpoint;
use zk0_protocol::tlog::tree::Frontier;

/// An operator with a ledger.
pub struct Operator {
    /// Without an aggregator.
    pub ledger: Ledger,
    /// The newest entry's time.
    pub time_ms: u64,
}

/// A proposal of the governor.
pub fn proposed(state: &State, action: Action) -> Body {
    let governor = SigningNode::new(GOVERNOR);
    let proposal = Proposal {
        network: *state.network(),
        number: state.next_proposal(),
        proposer: governor.id(),
        title: "another network".into(),
        text: String::new(),
        action,
    };
    Body::Proposed(Signed::new(proposal, &governor.key))
}

/// The governor's vote on the newest proposal.
pub fn voted(state: &State, ballot: Ballot) -> Body {
    let governor = SigningNode::new(GOVERNOR);
    let proposal = state.next_proposal() - 1;
    let vote = Vote {
        network: *state.network(),
        proposal,
        of: state.proposals()[&proposal].digest,
        voter: governor.id(),
        ballot,
    };
    Body::Voted(Signed::new(vote, &governor.key))
}

impl Operator {
    /// Founds a network of these nodes and datasets.
    pub fn founds(dir: &Path, genesis: Genesis, nodes: &[&SigningNode]) -> Self {
        let (ledger, _) = Ledger::create(dir, genesis, log_key(), START_MS).unwrap();
        for blob in [&weights(0)[..], POLICY] {
            ledger.blobs().put(blob).unwrap();
        }
        let mut operator = Self {
            ledger,
            time_ms: START_MS,
        };
        for node in nodes {
            operator.append(Body::NodeEnrolled(NodeEnrolled {
                node: node.id(),
                name: format!("node {}", node.seed),
            }));
            let leaves = node.list();
            operator.ledger.blobs().put(&leaves).unwrap();
            let registration = node.registration(operator.state().network());
            operator.append(Body::DatasetCommitted(registration));
        }
        operator
    }

    /// The ledger's state.
    pub fn state(&self) -> &State {
        self.ledger.state()
    }

    /// Appends an allowed entry. Returns its index.
    pub fn append(&mut self, body: Body) -> u64 {
        self.time_ms += 1;
        self.ledger.append(self.time_ms, body).unwrap().index
    }

    /// Proposes, votes, and executes. Returns the index of the entry that puts the action in force.
    pub fn decide(&mut self, action: Action) -> u64 {
        let number = self.state().next_proposal();
        self.append(proposed(self.state(), action));
        self.append(voted(self.state(), Ballot::For));
        self.time_ms += VOTING_MS;
        let settled = ProposalSettled {
            proposal: number,
            outcome: Outcome::Executed,
        };
        self.append(Body::ProposalSettled(settled))
    }

    /// Opens the next round.
    pub fn open(&mut self) {
        let opening = self.state().next_opening(self.time_ms + 1).unwrap();
        self.append(Body::RoundOpened(opening));
    }

    /// A claim about update `seed`, after a commitment and randomness.
    pub fn submission(
        &mut self,
        node: &SigningNode,
        seed: u32,
        proof: &[u8],
    ) -> Signed<Submission> {
        self.submission_of(node, &weights(seed), proof)
    }

    /// [`Self::submission`] for this update.
    pub fn submission_of(
        &mut self,
        node: &SigningNode,
        update: &[u8],
        proof: &[u8],
    ) -> Signed<Submission> {
        self.ledger.blobs().put(proof).unwrap();
        let round = self.state().round().unwrap();
        if !round.commits.contains_key(&node.id()) {
            self.commit(node, update);
            self.draw();
        }
        let claim = node.claim_of(self.state().expected_claim(&node.id()).unwrap());
        node.submission(claim, proof)
    }

    /// Commits to an update.
    pub fn commit(&mut self, node: &SigningNode, update: &[u8]) {
        self.ledger.blobs().put(update).unwrap();
        let round = self.state().round().unwrap().number();
        let commitment = node.commitment(self.state().network(), round, update);
        self.append(Body::UpdateCommitted(Signed::new(commitment, &node.key)));
    }

    /// Closes the commitments, if needed past their deadline.
    pub fn close_commitments(&mut self) {
        let deadline_ms = self.state().round().unwrap().opened.commit_deadline_ms;
        if self
            .state()
            .next_commitments_closed(self.time_ms + 1)
            .is_none()
        {
            self.time_ms = deadline_ms;
        }
        let closed = self.state().next_commitments_closed(self.time_ms + 1);
        self.append(Body::CommitmentsClosed(closed.unwrap()));
    }

    /// Closes the commitments, and draws the randomness.
    pub fn draw(&mut self) {
        self.close_commitments();
        let round = self.state().round().unwrap();
        let drawn = RandomnessDrawn {
            round: round.number(),
            drawing: Drawing::LogVrf(self.ledger.vrf(&round.closing.unwrap().commitments)),
        };
        self.append(Body::RandomnessDrawn(drawn));
    }

    /// Closes the round with the weights `seed`.
    pub fn close(&mut self, seed: u32) {
        let file = weights(seed);
        self.ledger.blobs().put(&file).unwrap();
        let closed = RoundClosed {
            round: self.state().round().unwrap().number(),
            global: digest(&file),
            contributors: self.state().contributors(),
            unanswered: self.state().unanswered(),
            evaluated: None,
        };
        self.append(Body::RoundClosed(closed));
    }

    /// A round whose accepted update `seed` becomes the weights. Returns the acceptance's index.
    pub fn round(&mut self, node: &SigningNode, seed: u32, proof: &[u8]) -> u64 {
        self.open();
        let submission = self.submission(node, seed, proof);
        let accepted = self.append(Body::ContributionAccepted(submission));
        self.close(seed);
        accepted
    }

    /// Appends and signs a forbidden entry.
    pub fn forge(self, body: Body) {
        let dir = self.ledger.dir().to_path_buf();
        let size = self.ledger.size();
        let mut tree = Frontier::default();
        for index in 0..size {
            let entry = self.ledger.entry(index).unwrap();
            tree.push(&entry.encode().unwrap()).unwrap();
        }
        drop(self.ledger);
        let forged = Entry {
            version: ENTRY_VERSION,
            time_ms: self.time_ms + 1,
            body,
        };
        let bytes = forged.encode().unwrap();
        let hashes = tree.push(&bytes).unwrap();
        let checkpoint = Checkpoint {
            size: size + 1,
            root: tree.root().unwrap(),
        };
        let signed = checkpoint.sign(&super::genesis().name, &log_key()).unwrap();
        let store = Store::open(&folder::database(&dir)).unwrap();
        let mut batch = StoreBatch::default();
        batch.entry(size, &bytes, &hashes);
        batch.checkpoint(size + 1, &signed);
        store.commit(batch).unwrap();
        drop(store);
        fs::write(folder::checkpoint(&dir), signed).unwrap();
    }
}
