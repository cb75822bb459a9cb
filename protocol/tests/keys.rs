//! Keys and signatures that somebody made up on purpose. Signed statements and log signatures get the verdict of dalek's strict
//! verification, whichever keys are known already.

use curve25519_dalek::constants::EIGHT_TORSION;
use curve25519_dalek::{EdwardsPoint, Scalar};
use ed25519_dalek::{Signature, SigningKey, Verifier as _, VerifyingKey};
use proptest::prelude::*;
use sha2::{Digest as _, Sha512};
use signed_note::Verifier as _;
use zk0_circuits::{Digest, NodeId};
use zk0_protocol::entries::entry::ENTRY_VERSION;
use zk0_protocol::entries::known_keys::{KnownKeys, MAX_KNOWN_KEYS};
use zk0_protocol::entries::member::NodeEnrolled;
use zk0_protocol::entries::proposal::Ballot;
use zk0_protocol::entries::signed::{KeyRotation, KeyTakeover, SignableStatement, Vote};
use zk0_protocol::tlog::verifier_key::Role;
use zk0_protocol::{Body, Entry, Signed, VerifierKey};

fn entry(body: Body) -> Entry {
    Entry {
        version: ENTRY_VERSION,
        time_ms: 0,
        body,
    }
}

fn enrolled(node: NodeId) -> Entry {
    entry(Body::NodeEnrolled(NodeEnrolled {
        node,
        name: "robot".into(),
    }))
}

/// The public key of the secret `number`.
fn numbered(number: u64) -> NodeId {
    NodeId(EdwardsPoint::mul_base(&Scalar::from(number)).compress().0)
}

fn vote(voter: [u8; 32], network: u8) -> Vote {
    Vote {
        network: Digest([network; 32]),
        proposal: 0,
        of: Digest([2; 32]),
        voter: NodeId(voter),
        ballot: Ballot::For,
    }
}

/// The bytes that are signed for a vote.
fn message(vote: &Vote) -> Vec<u8> {
    [Vote::TAG.as_bytes(), b"\0", &borsh::to_vec(vote).unwrap()].concat()
}

/// Whether dalek's own strict verification accepts, starting from the key's bytes.
fn strict(key: &[u8; 32], message: &[u8], signature: &Signature) -> bool {
    VerifyingKey::from_bytes(key).is_ok_and(|key| key.verify_strict(message, signature).is_ok())
}

/// Returns what our own code states. All places have to state the same.
fn ours(vote: &Vote, signature: &Signature) -> bool {
    let signed = Signed {
        statement: *vote,
        signature: signature.to_bytes(),
    };
    let alone = signed.verify().is_ok();
    let entry = entry(Body::Voted(signed));
    let mut keys = KnownKeys::default();
    assert_eq!(entry.authenticate(&keys).is_ok(), alone);
    keys.learn(&entry);
    assert!(!keys.lacks(&entry) || keys.is_empty());
    assert_eq!(entry.authenticate(&keys).is_ok(), alone);
    let log = VerifierKey::new(Role::Log, "log.example", &vote.voter.0);
    let as_log = log.is_ok_and(|log| log.verify(&message(vote), &signature.to_bytes()));
    assert_eq!(as_log, alone);
    alone
}

fn challenge(r: &[u8; 32], key: &[u8; 32], message: &[u8]) -> Scalar {
    let hash = Sha512::new().chain_update(r).chain_update(key);
    Scalar::from_bytes_mod_order_wide(&hash.chain_update(message).finalize().into())
}

proptest! {
    /// Signatures by somebody who chooses every part: the secret, the nonce, and points of small order that are added to the key
    /// and to R.
    #[test]
    fn accepts_what_strict_verification_accepts(
        secret in any::<[u8; 32]>(),
        nonce in prop_oneof![Just([0; 32]), any::<[u8; 32]>()],
        of_key in 0..8usize,
        of_r in 0..8usize,
        weak in any::<bool>(),
        network in any::<u8>(),
        flipped in prop::option::of(0..768usize),
    ) {
        let secret = if weak { Scalar::ZERO } else { Scalar::from_bytes_mod_order(secret) };
        let nonce = Scalar::from_bytes_mod_order(nonce);
        let point = |scalar: &Scalar, torsion: usize| {
            (EdwardsPoint::mul_base(scalar) + EIGHT_TORSION[torsion]).compress().0
        };
        let mut key = point(&secret, of_key);
        let r = point(&nonce, of_r);
        let s = nonce + challenge(&r, &key, &message(&vote(key, network))) * secret;
        let mut signature = [r, s.to_bytes()].concat();
        if let Some(bit) = flipped {
            let bytes = if bit < 512 { &mut signature[..] } else { &mut key[..] };
            bytes[bit % 512 / 8] ^= 1 << (bit % 8);
        }
        let signature = Signature::from_slice(&signature).unwrap();
        let vote = vote(key, network);
        prop_assert_eq!(ours(&vote, &signature), strict(&key, &message(&vote), &signature));
    }
}

/// Anyone who has the key can sign with an R that does not come from a nonce. Plain verification accepts that signature.
#[test]
fn r_of_small_order_is_refused() {
    let secret = Scalar::from(7u64);
    let key = EdwardsPoint::mul_base(&secret).compress().0;
    let vote = vote(key, 1);
    let r = EIGHT_TORSION[0].compress().0;
    let s = challenge(&r, &key, &message(&vote)) * secret;
    let signature = Signature::from_components(r, s.to_bytes());
    let plain = VerifyingKey::from_bytes(&key).unwrap();
    assert!(plain.verify(&message(&vote), &signature).is_ok());
    assert!(!ours(&vote, &signature));
}

#[test]
fn keys_of_small_order_are_refused() {
    for point in EIGHT_TORSION {
        let key = point.compress().0;
        let mut keys = KnownKeys::default();
        assert_eq!(keys.key(&NodeId(key)), None);
        assert!(VerifierKey::new(Role::Log, "log.example", &key).is_err());
        let enrolled = enrolled(NodeId(key));
        assert!(enrolled.authenticate(&keys).is_err());
        keys.learn(&enrolled);
        assert!(keys.is_empty());
    }
}

#[test]
fn keys_beyond_those_that_are_kept_have_the_same_verdicts() {
    let mut keys = KnownKeys::default();
    for number in 1..=MAX_KNOWN_KEYS as u64 + 10 {
        let node = numbered(number);
        keys.learn(&enrolled(node));
        assert_eq!(keys.key(&node).unwrap().as_bytes(), &node.0);
    }
    assert_eq!(keys.len(), MAX_KNOWN_KEYS);
    let secret = SigningKey::from_bytes(&[7; 32]);
    let good = Signed::new(vote(secret.verifying_key().to_bytes(), 1), &secret);
    let mut bad = good.clone();
    bad.signature[3] ^= 1;
    let (good, bad) = (entry(Body::Voted(good)), entry(Body::Voted(bad)));
    for known in [&KnownKeys::default(), &keys] {
        assert!(good.authenticate(known).is_ok());
        assert!(bad.authenticate(known).is_err());
        let weak = enrolled(NodeId(EIGHT_TORSION[1].compress().0));
        assert!(weak.authenticate(known).is_err());
    }
}

#[test]
fn a_key_that_its_node_has_replaced_is_dropped() {
    let [old, new] = [1, 2].map(|byte| SigningKey::from_bytes(&[byte; 32]));
    let [node, with] = [&old, &new].map(|key| NodeId(key.verifying_key().to_bytes()));
    let mut keys = KnownKeys::default();
    keys.learn(&enrolled(node));
    let rotation = KeyRotation {
        network: Digest([1; 32]),
        node,
        with,
    };
    let rotated = entry(Body::KeyRotated {
        rotation: Signed::new(rotation, &old),
        takeover: Signed::new(KeyTakeover { rotation }, &new),
    });
    assert!(rotated.authenticate(&keys).is_ok());
    assert!(keys.lacks(&rotated));
    keys.learn(&rotated);
    assert!(!keys.lacks(&rotated));
    assert_eq!(keys.len(), 1);
    assert!(rotated.authenticate(&keys).is_ok());
}
