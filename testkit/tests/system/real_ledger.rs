//! What tests do with the ledger that a demo left, with real proofs in it (`tests/fixtures/ledger`). `make fixtures` makes it again.

use std::path::Path;
use tempfile::TempDir;
use zk0_circuits::vm::merkle;
use zk0_ledger::blobs::Blobs;
use zk0_protocol::entries::entry::{Body, Entry};
use zk0_protocol::entries::signed::{Signed, Submission};
use zk0_protocol::rules::network_rules::Rules;
use zk0_protocol::rules::state::State;
use zk0_testkit::aggregator::{copy_of, REAL};
use zk0_verifier::UnverifiedContribution;

/// A copy of the ledger, which a test may change.
pub fn ledger_copy() -> TempDir {
    copy_of(Path::new(REAL))
}

/// An accepted contribution of a ledger: what was submitted, when, and in which state of the ledger.
pub struct Accepted {
    /// The submission, the proof, the update and the base weights.
    pub contribution: UnverifiedContribution,
    /// The state before it was recorded.
    pub state: State,
    /// The index of its entry.
    pub index: u64,
    /// The time of its entry.
    pub time_ms: u64,
}

/// Finds the first accepted contribution of the ledger in `dir`.
pub fn accepted(dir: &Path) -> Accepted {
    let mut all = all_accepted(dir).into_iter();
    all.next().expect("the ledger has an accepted contribution")
}

/// Finds all accepted contributions of the ledger in `dir`, in its order.
pub fn all_accepted(dir: &Path) -> Vec<Accepted> {
    let (entries, _) = zk0_audit::verified_entries::verified_entries(dir).expect("a ledger");
    let blobs = Blobs::at(dir);
    let (mut leaves, mut accepted) = (Vec::new(), Vec::new());
    let mut state: Option<State> = None;
    for (index, entry) in (0..).zip(entries) {
        if let (Body::ContributionAccepted(submission), Some(state)) = (&entry.body, &state) {
            accepted.push(Accepted {
                contribution: contribution(submission, state.rules(), &blobs),
                state: state.clone(),
                index,
                time_ms: entry.time_ms,
            });
        }
        leaves.push(merkle::leaf_hash(
            &entry.encode().expect("an entry of the log"),
        ));
        fold(&mut state, &merkle::root(&leaves), &entry);
    }
    accepted
}

fn contribution(
    submission: &Signed<Submission>,
    rules: &Rules,
    blobs: &Blobs,
) -> UnverifiedContribution {
    UnverifiedContribution::read(submission, rules, |digest, limit| blobs.get(digest, limit))
        .expect("the blobs of the fixture")
}

fn fold(state: &mut Option<State>, root: &zk0_circuits::Digest, entry: &Entry) {
    match state {
        None => *state = Some(State::found(entry).expect("a genesis")),
        Some(state) => state.apply(root, entry).expect("an entry the rules allow"),
    }
}

/// Returns the state with other rules. The state encodes the rules twice: in the genesis, and as the rules in force.
pub fn with_rules(state: &State, change: impl FnOnce(&mut Rules)) -> State {
    let mut rules = state.rules().clone();
    let encoded = borsh::to_vec(&rules).unwrap();
    change(&mut rules);
    let mut bytes = borsh::to_vec(state).unwrap();
    let genesis = borsh::to_vec(state.genesis()).unwrap().len();
    let at = genesis
        + bytes[genesis..]
            .windows(encoded.len())
            .position(|window| window == encoded)
            .unwrap();
    bytes.splice(at..at + encoded.len(), borsh::to_vec(&rules).unwrap());
    borsh::from_slice(&bytes).unwrap()
}
