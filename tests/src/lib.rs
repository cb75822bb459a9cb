//! Tests of the whole system. The tests of one crate are in that crate; those of the binary are in `cli/tests`.
//!
//! - `structure`: the crates depend on one another as the map says, and an auditor's build stays light.
//! - `targets`: what runs in browsers and in the guest compiles for these targets.
//! - `deletions`: checks are removed from a copy of the sources, and tests have to fail.
//! - `attacks`: one attack for each row of the table of attacks, which is refused, and succeeds where its defence is taken out.
//! - `verifier_attacks`: a contribution with a real proof, in which one thing at a time is changed.
//! - `averages`: the result of a real round, and another one in its place.
//! - `denials`: an operator denies that a contribution with a real proof verifies.
//! - `ledger_tampering`: the replay of a real ledger, in which one byte at a time is changed.
//!
//! The last four work on `fixtures/ledger`, a ledger that a demo left. `make fixtures` makes it again.

pub mod changed_copy;

use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;
use zk0_circuits::vm::merkle;
use zk0_ledger::blobs::Blobs;
use zk0_protocol::entries::entry::{Body, Entry};
use zk0_protocol::entries::signed::{Signed, Submission};
use zk0_protocol::rules::network_rules::Rules;
use zk0_protocol::rules::state::State;
use zk0_verifier::UnverifiedContribution;

/// A file or folder under `tests/fixtures`.
pub fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("fixtures")
        .join(name)
}

/// A copy of a real demo's ledger, which a test may change.
pub fn ledger_copy() -> TempDir {
    let dir = tempfile::tempdir().expect("a temporary folder");
    copy(&fixture("ledger"), dir.path());
    dir
}

/// Copies a folder with all that is in it.
pub fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).expect("creating a folder");
    for entry in fs::read_dir(from).expect("the fixture is there: see `make fixtures`") {
        let entry = entry.expect("reading a folder");
        let (path, place) = (entry.path(), to.join(entry.file_name()));
        match path.is_dir() {
            true => copy(&path, &place),
            false => drop(fs::copy(&path, &place).expect("copying a file")),
        }
    }
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
