//! Only what the ledger knows counts: a contribution of an enrolled node, and in the average the update that was accepted of it.

use std::path::{Path, PathBuf};
use zk0_circuits::{Digest, NodeId, WeightsDigest};
use zk0_ledger::{replay, Blobs, Finding, Recheck};
use zk0_protocol::rules::state::Commit;
use zk0_protocol::{Body, Entry, RefusalCode, State};
use zk0_verifier::close::{combined, CloseError};
use zk0_verifier::combine::strategy::Global;
use zk0_verifier::{authenticate, verify, BaseFiles, UnverifiedContribution, VerifiedContribution};

/// What happened in a real ledger.
#[derive(Default)]
struct Real {
    /// The state after the genesis, in which no node is enrolled.
    founded: Option<State>,
    /// The first contribution that was accepted.
    accepted: Option<Accepted>,
}

struct Accepted {
    contribution: UnverifiedContribution,
    before: State,
    entry: Entry,
}

impl Recheck for Real {
    fn entry(&mut self, before: &State, _: u64, entry: &Entry, blobs: &Blobs) -> Vec<Finding> {
        self.founded.get_or_insert_with(|| before.clone());
        if let (Body::ContributionAccepted(submission), None) = (&entry.body, &self.accepted) {
            let get = |digest: &Digest, limit| blobs.get(digest, limit);
            let contribution = UnverifiedContribution::read(submission, before.rules(), get);
            self.accepted = Some(Accepted {
                contribution: contribution.unwrap(),
                before: before.clone(),
                entry: entry.clone(),
            });
        }
        Vec::new()
    }
}

fn dir() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/fixtures/ledger")
}

fn real() -> (State, Accepted) {
    let mut real = Real::default();
    replay(&dir(), None, &mut real);
    (real.founded.unwrap(), real.accepted.unwrap())
}

#[test]
fn a_stranger_contributes_nothing() {
    let (founded, real) = real();
    let UnverifiedContribution {
        submission, proof, ..
    } = real.contribution;
    let node = submission.statement.claim.terms.node;
    let before = real.before.claim_context(&node);
    assert!(authenticate(submission.clone(), proof.clone(), &before).is_ok());
    assert_eq!(
        authenticate(submission, proof, &founded.claim_context(&node)),
        Err(RefusalCode::NotEnrolled(node).into())
    );
}

/// An aggregator that mixes up the rounds of a node averages an update that is proven, but was not accepted in this round.
#[test]
fn another_update_than_the_accepted_one_is_not_averaged() {
    let (_, real) = real();
    let UnverifiedContribution {
        submission,
        proof,
        weights,
    } = real.contribution;
    let node = submission.statement.claim.terms.node;
    let context = real.before.claim_context(&node);
    let authentic = authenticate(submission, proof, &context).unwrap();
    let verified = verify(&authentic, &weights, &context, real.entry.time_ms).unwrap();
    let (node, given) = (verified.node(), verified.claim().terms.update);
    let mut after = real.before;
    after.apply(&Digest::default(), &real.entry).unwrap();
    assert!(of_one(&after, &verified).is_ok());

    let changes: [fn(&mut WeightsDigest); 2] = [
        |update| update.blob.0[0] ^= 1,
        |update| update.quantised.0[0] ^= 1,
    ];
    for change in changes {
        let mut accepted = given;
        change(&mut accepted);
        let other = committed(&after, &node, |commit| commit.update = accepted);
        assert_eq!(
            of_one(&other, &verified),
            Err(CloseError::OtherUpdate {
                node,
                accepted: accepted.blob,
                given: given.blob,
            })
        );
    }
}

/// What this contribution alone combines to.
fn of_one(state: &State, one: &VerifiedContribution) -> Result<Option<Global>, CloseError> {
    let blobs = Blobs::at(&dir());
    let read_at = |digest: &_, place, buffer: &mut [u8]| blobs.read_at(digest, place, buffer);
    combined(
        state,
        std::slice::from_ref(one),
        &BaseFiles::default(),
        read_at,
        &mut std::io::sink(),
    )
}

/// The state with another commitment of a node. Nobody but the node could sign it.
fn committed(state: &State, node: &NodeId, change: impl FnOnce(&mut Commit)) -> State {
    let mut commit = state.round().unwrap().commits[node].clone();
    let encoded = borsh::to_vec(&commit).unwrap();
    change(&mut commit);
    let mut bytes = borsh::to_vec(state).unwrap();
    let mut windows = bytes.windows(encoded.len());
    let at = windows.position(|window| window == encoded).unwrap();
    bytes.splice(at..at + encoded.len(), borsh::to_vec(&commit).unwrap());
    borsh::from_slice(&bytes).unwrap()
}
