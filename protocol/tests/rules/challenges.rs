//! Commitments close before the randomness of the challenges exists, and nobody can grind a challenge.

use super::refused;
use curve25519_dalek::edwards::EdwardsPoint;
use curve25519_dalek::scalar::Scalar;
use sha2::{Digest as _, Sha512};
use std::collections::BTreeSet;
use zk0_circuits::claim::challenge::{challenge, sample_indices};
use zk0_circuits::vm::digest::tagged_sha256;
use zk0_circuits::vm::merkle;
use zk0_circuits::{Digest, NodeId};
use zk0_protocol::challenge::closing;
use zk0_protocol::challenge::drawing::{Drawing, RandomnessError};
use zk0_protocol::challenge::source::RandomnessSource;
use zk0_protocol::challenge::vrf::VrfProof;
use zk0_protocol::entries::entry::RandomnessDrawn;
use zk0_protocol::entries::signed::{SignableStatement, UpdateCommitment};
use zk0_protocol::tlog::cosigner::Cosigner;
use zk0_protocol::{Body, Checkpoint, Genesis, RefusalCode, RuleViolation, Signed, State};
use zk0_testkit::network::beacon::Beacon;
use zk0_testkit::network::*;

fn challenge_of(state: &State, node: u8) -> Digest {
    state.expected_claim(&id(node)).unwrap().terms.challenge
}

fn bad(violation: RuleViolation) -> RandomnessError {
    match violation {
        RuleViolation::BadRandomness { error, .. } => error,
        other => panic!("{other}"),
    }
}

/// A network with this source, in which two nodes have committed and the commitments are closed.
fn closed_with(breaks: impl FnOnce(&mut Genesis)) -> Chain {
    let mut genesis = genesis();
    breaks(&mut genesis);
    let mut chain = Chain::founded(genesis);
    for node in 0..2 {
        chain.apply(enrolled(node));
        chain.apply(registered(&chain.state.network().clone(), node));
    }
    chain.open();
    for node in 0..2 {
        chain.apply(committed(&chain.state, node, weights(0x10 + node)));
    }
    chain.close_commitments();
    chain
}

fn drawn_as(drawing: Drawing) -> Body {
    Body::RandomnessDrawn(RandomnessDrawn { round: 0, drawing })
}

#[test]
fn commitments_close_at_their_deadline_or_when_all_have_committed() {
    let closing = |chain: &Chain| Body::CommitmentsClosed(commitments_closed(&chain.state));
    let mut chain = Chain::in_round(2);
    let early = chain.refusal(closing(&chain));
    assert!(matches!(early, RuleViolation::CommitmentsOpen { .. }));
    chain.apply(committed(&chain.state, 0, weights(0x10)));
    let early = chain.refusal(closing(&chain));
    assert!(matches!(early, RuleViolation::CommitmentsOpen { node, .. } if node == id(1)));
    let deadline_ms = chain.state.round().unwrap().opened.commit_deadline_ms;
    let mut waited = Chain {
        state: chain.state.clone(),
        time_ms: deadline_ms - 1,
    };
    waited.refusal(closing(&waited));
    waited.apply(closing(&waited));
    // All have committed, so nothing is left to wait for.
    chain.apply(committed(&chain.state, 1, weights(0x11)));
    let mut wrong = commitments_closed(&chain.state);
    wrong.commitments = digest(0);
    assert!(matches!(
        chain.refusal(Body::CommitmentsClosed(wrong)),
        RuleViolation::RoundField {
            field: "commitments",
            ..
        }
    ));
    wrong.round = 1;
    let none = chain.refusal(Body::CommitmentsClosed(wrong));
    assert_eq!(none, RuleViolation::RoundNotOpen(1));
    chain.apply(closing(&chain));
    let again = chain.refusal(closing(&chain));
    assert!(matches!(again, RuleViolation::Again { .. }));
}

#[test]
fn nobody_commits_or_claims_between_the_closing_and_the_randomness() {
    let mut chain = Chain::in_round(2);
    chain.apply(committed(&chain.state, 0, weights(0x10)));
    let early = chain.refusal(Body::RandomnessDrawn(drawn(&chain.state)));
    assert_eq!(early, RuleViolation::NotClosed(0));
    let no_randomness = RefusalCode::NoRandomness { round: 0 };
    let unknown = chain.state.expected_claim(&id(0));
    assert_eq!(unknown, Err(no_randomness.into()));
    chain.close_commitments();
    let late = committed(&chain.state, 1, weights(0x11));
    chain.time_ms = chain.state.time_ms() - 1;
    let late = refused(chain.refusal(late));
    assert_eq!(late, RefusalCode::CommitmentsClosed { round: 0 });
    // A claim is turned away, whatever it states, and nobody can have it refused on the ledger.
    let mut ready = Chain {
        state: chain.state.clone(),
        time_ms: chain.time_ms,
    };
    ready.apply(Body::RandomnessDrawn(drawn(&ready.state)));
    for body in [
        accepted(&ready.state, 0),
        rejected(&ready.state, 0, invalid_proof()),
    ] {
        assert_eq!(refused(chain.refusal(body)), no_randomness);
    }
    chain.apply(Body::RandomnessDrawn(drawn(&chain.state)));
    let again = chain.refusal(Body::RandomnessDrawn(drawn(&chain.state)));
    assert!(matches!(again, RuleViolation::Again { .. }));
    chain.apply(accepted(&ready.state, 0));
}

#[test]
fn a_round_without_randomness_closes_and_keeps_its_base() {
    let mut chain = closed_with(|_| {});
    let deadline_ms = chain.time_ms + RANDOMNESS_WINDOW;
    let close = |chain: &Chain| Body::RoundClosed(closed(&chain.state, weights(4)));
    chain.time_ms = deadline_ms - 1;
    let early = chain.refusal(close(&chain));
    assert!(matches!(early, RuleViolation::ClosedEarly { .. }));
    assert!(chain.state.to_draw(deadline_ms).is_some());
    assert!(chain.state.to_draw(deadline_ms + 1).is_none());
    chain.time_ms = deadline_ms;
    let late = chain.refusal(Body::RandomnessDrawn(drawn(&chain.state)));
    assert_eq!(
        late,
        RuleViolation::RandomnessLate {
            round: 0,
            late_ms: 1
        }
    );
    chain.time_ms = deadline_ms;
    let other = chain.refusal(Body::RoundClosed(closed(&chain.state, weights(0x50))));
    assert!(matches!(
        other,
        RuleViolation::RoundField {
            field: "global",
            ..
        }
    ));
    // Nobody could answer, so nobody is stated to have left a commitment unanswered.
    assert!(closed(&chain.state, weights(4)).unanswered.is_empty());
    chain.apply(close(&chain));
    assert_eq!(chain.state.global(), &weights(4));
    let record = chain.state.node(&id(0)).unwrap().record;
    assert_eq!(record.failures(&chain.state.rules().unanswered), 0);
    chain.open();
}

#[test]
fn the_logs_function_draws_one_value_for_the_commitments() {
    let mut chain = closed_with(|_| {});
    let closing = chain.state.round().unwrap().closing.unwrap();
    // Another key, and a proof for other commitments.
    for proof in [
        VrfProof::of(&key(0), &closing.commitments.0),
        VrfProof::of(&log_key(), &digest(1).0),
        VrfProof([0xff; 80]),
    ] {
        let error = bad(chain.refusal(drawn_as(Drawing::LogVrf(proof))));
        assert_eq!(error, RandomnessError::Vrf(closing.commitments));
    }
    let other = Drawing::Drand {
        round: 1,
        signature: [0; 48],
    };
    let other = bad(chain.refusal(drawn_as(other)));
    assert!(matches!(other, RandomnessError::OtherSource { .. }));
    chain.apply(Body::RandomnessDrawn(drawn(&chain.state)));
    let randomness = chain.state.round().unwrap().randomness.unwrap();
    let output = VrfProof::of(&log_key(), &closing.commitments.0).output();
    let value = tagged_sha256("zk0/randomness-of-vrf/v1", &[&output.unwrap()]);
    assert_eq!(randomness.value, value);
    let commitment = closing::commitment(&commitment(&chain.state, 1, weights(0x11)));
    let network = chain.state.network();
    let expected = challenge(network, 0, &id(1), &commitment, &value);
    assert_eq!(challenge_of(&chain.state, 1), expected);
    assert_ne!(challenge_of(&chain.state, 0), expected);
}

#[test]
fn a_beacon_is_of_the_first_round_after_the_closing() {
    let (beacon, stranger) = (Beacon::new(5), Beacon::new(6));
    let chain_of = |beacon: &Beacon| Box::new(beacon.chain(T0 / 1000 - 100, 1_000));
    let mut chain = closed_with(|genesis| {
        genesis.rules.randomness = RandomnessSource::Drand(chain_of(&beacon));
        genesis.rules.randomness_window_ms = 60_000;
    });
    let closing = chain.state.round().unwrap().closing.unwrap();
    let rules = chain_of(&beacon);
    let round = rules.round_after(closing.time_ms);
    let signed = |by: &Beacon, round| Drawing::Drand {
        round,
        signature: by.sign(round),
    };
    // The beacon does not exist yet.
    let early = bad(chain.refusal(drawn_as(signed(&beacon, round))));
    assert!(
        matches!(early, RandomnessError::BeforeBeacon { .. }),
        "{early}"
    );
    chain.time_ms = rules.time_ms(round);
    for found in [round - 1, round + 1, 0, u64::MAX] {
        let error = bad(chain.refusal(drawn_as(signed(&beacon, found))));
        let expected = round;
        assert_eq!(error, RandomnessError::OtherRound { found, expected });
    }
    let wrong = Drawing::Drand {
        round,
        signature: beacon.sign(round + 1),
    };
    for wrong in [wrong, signed(&stranger, round)] {
        let error = bad(chain.refusal(drawn_as(wrong)));
        assert!(
            matches!(error, RandomnessError::BeaconSignature { .. }),
            "{error}"
        );
    }
    let by_log = bad(chain.refusal(Body::RandomnessDrawn(drawn(&chain.state))));
    assert!(matches!(by_log, RandomnessError::OtherSource { .. }));
    chain.apply(drawn_as(signed(&beacon, round)));
    // drand's own randomness: the SHA-256 of the signature.
    let randomness = chain.state.round().unwrap().randomness.unwrap();
    let published = zk0_circuits::vm::digest::sha256(&[&beacon.sign(round)]);
    assert_eq!(randomness.value, published);
    chain.apply(accepted(&chain.state, 0));
}

#[test]
fn all_witnesses_cosign_the_closing_in_the_order_of_the_rules() {
    let cosigners = [1, 2].map(|number| {
        Cosigner::new(&format!("witness.example/w{number}"), governor_key(number)).unwrap()
    });
    let [one, other] = cosigners
        .each_ref()
        .map(|cosigner| cosigner.key().to_string());
    let mut chain = closed_with(|genesis| {
        genesis.rules.witness_policy = format!(
            "witness A {one} https://a.example\nwitness B {other} https://b.example\ngroup any 1 A B\nquorum any\n"
        );
        genesis.rules.randomness = RandomnessSource::Witnesses;
    });
    let closing = chain.state.round().unwrap().closing.unwrap();
    let cosign = |checkpoint: Checkpoint, time_s: u64| -> Vec<[u8; 72]> {
        let text = checkpoint.text("zk0.example/test").unwrap();
        let lines = cosigners
            .iter()
            .map(|cosigner| cosigner.cosign(&text, time_s));
        let bytes = lines.map(|line| {
            let line = line.strip_suffix(b"\n").unwrap();
            let signature = signed_note::Signature::from_bytes(line).unwrap();
            signature.signature().try_into().unwrap()
        });
        bytes.collect()
    };
    let right = Checkpoint {
        size: closing.entry + 1,
        root: closing.root,
    };
    let of = |checkpoint| Drawing::Witnesses(cosign(checkpoint, 1_700_000_000));
    // A quorum is not enough, because the aggregator could choose among quorums.
    let few = Drawing::Witnesses(cosign(right, 1)[..1].to_vec());
    let few = bad(chain.refusal(drawn_as(few)));
    assert!(
        matches!(
            few,
            RandomnessError::OtherCount {
                found: 1,
                expected: 2
            }
        ),
        "{few}"
    );
    let mut swapped = cosign(right, 1);
    swapped.swap(0, 1);
    let root = digest(0x77);
    let later = Checkpoint {
        size: right.size + 1,
        ..right
    };
    for wrong in [
        Drawing::Witnesses(swapped),
        of(Checkpoint { root, ..right }),
        of(later),
    ] {
        let error = bad(chain.refusal(drawn_as(wrong)));
        assert!(
            matches!(error, RandomnessError::BadCosignature { .. }),
            "{error}"
        );
    }
    // A witness that signs at another second gives another value, and so does a signature with another nonce: this source does not
    // resist its witnesses, as its documentation states.
    let at = |time_s| Drawing::Witnesses(cosign(right, time_s)).value().unwrap();
    assert_eq!(at(5), at(5));
    assert_ne!(at(5), at(6));
    chain.apply(drawn_as(of(right)));
    chain.apply(accepted(&chain.state, 0));
}

/// A signature of `statement` with this nonce. A node can make as many valid signatures of one statement as it likes.
fn sign_with(statement: UpdateCommitment, node: u8, nonce: u64) -> Signed<UpdateCommitment> {
    let mut message = UpdateCommitment::TAG.as_bytes().to_vec();
    message.push(0);
    message.extend(borsh::to_vec(&statement).unwrap());
    let secret = key(node);
    let (nonce, public) = (Scalar::from(nonce), secret.verifying_key().to_bytes());
    let point = EdwardsPoint::mul_base(&nonce).compress();
    let hash = Sha512::new()
        .chain_update(point.as_bytes())
        .chain_update(public)
        .chain_update(&message);
    let hash = Scalar::from_bytes_mod_order_wide(&hash.finalize().into());
    let answer = nonce + hash * secret.to_scalar();
    let mut signature = [0; 64];
    signature[..32].copy_from_slice(point.as_bytes());
    signature[32..].copy_from_slice(answer.as_bytes());
    Signed {
        statement,
        signature,
    }
}

/// The derivation that zk0 had before commitments closed first: the challenge followed from the tree that ends with the commitment.
fn challenge_of_the_entry(network: &Digest, node: &NodeId, index: u64, root: &Digest) -> Digest {
    let numbers = [0u64.to_le_bytes(), index.to_le_bytes()];
    let parts: [&[u8]; 5] = [&network.0, &numbers[0], &node.0, &numbers[1], &root.0];
    tagged_sha256("zk0/challenge/v1", &parts)
}

/// A node tries signature nonces and milliseconds until the challenge draws the two easiest samples of its ten. Against the old
/// derivation it succeeds: each try is another challenge. Now all tries have one challenge, and nobody knows it before the
/// commitments are closed.
#[test]
fn a_node_that_grinds_signatures_and_times_gains_nothing() {
    const NONCES: u64 = 40;
    const TIMES: u64 = 8;
    let easy = |challenge: &Digest| {
        let mut drawn = sample_indices(challenge, 10, 2).unwrap();
        drawn.sort();
        drawn == [0, 1]
    };
    let chain = Chain::in_round(1);
    let network = *chain.state.network();
    let statement = commitment(&chain.state, 0, weights(0x10));
    // The leaves of the entries before; what they are does not matter.
    let before: Vec<Digest> = (0..chain.state.entries())
        .map(|at| digest(at as u8))
        .collect();
    let (mut old, mut new, mut closings) = (Vec::new(), BTreeSet::new(), BTreeSet::new());
    for nonce in 1..=NONCES {
        let signed = sign_with(statement.clone(), 0, nonce);
        signed.verify().unwrap();
        for late_ms in 1..=TIMES {
            let body = Body::UpdateCommitted(signed.clone());
            let committing = entry(chain.time_ms + late_ms, body);
            let leaf = merkle::leaf_hash(&committing.encode().unwrap());
            let mut leaves = [&before[..], &[leaf]].concat();
            let root = merkle::root(&leaves);
            let index = chain.state.entries();
            old.push(challenge_of_the_entry(&network, &id(0), index, &root));
            let mut tried = Chain {
                state: chain.state.clone(),
                time_ms: chain.time_ms + late_ms,
            };
            tried.state.apply(&root, &committing).unwrap();
            let unknown = tried.state.expected_claim(&id(0));
            assert_eq!(unknown, Err(RefusalCode::NoRandomness { round: 0 }.into()));
            // The closing too has the root of the whole tree, which every try changes.
            let body = Body::CommitmentsClosed(commitments_closed(&tried.state));
            tried.time_ms += 1;
            let closing = entry(tried.time_ms, body);
            leaves.push(merkle::leaf_hash(&closing.encode().unwrap()));
            tried.state.apply(&merkle::root(&leaves), &closing).unwrap();
            closings.insert(tried.state.round().unwrap().closing.unwrap().commitments);
            tried.apply(Body::RandomnessDrawn(drawn(&tried.state)));
            new.insert(challenge_of(&tried.state, 0));
        }
    }
    let distinct: BTreeSet<_> = old.iter().collect();
    assert_eq!(distinct.len() as u64, NONCES * TIMES);
    // One try in 45 draws the easiest two, so some of 320 do.
    assert!(old.iter().any(easy), "the old derivation could be ground");
    assert_eq!(
        (new.len(), closings.len()),
        (1, 1),
        "nothing to choose from"
    );
}

/// The aggregator cannot vary the input of the log's function either: the order and the times of entries do not enter.
#[test]
fn the_order_and_the_times_of_commitments_do_not_matter() {
    let closed_after = |order: [u8; 3], pause_ms: u64| {
        let mut chain = Chain::in_round(3);
        for node in order {
            chain.time_ms += pause_ms;
            chain.apply(committed(&chain.state, node, weights(0x10 + node)));
        }
        chain.draw();
        let round = chain.state.round().unwrap();
        (
            round.closing.unwrap().commitments,
            challenge_of(&chain.state, 1),
        )
    };
    let one = closed_after([0, 1, 2], 1);
    assert_eq!(one, closed_after([2, 0, 1], 100));
    // A commitment that is left out, or that states something else, changes everything.
    let mut fewer = Chain::in_round(3);
    for node in 0..2 {
        fewer.apply(committed(&fewer.state, node, weights(0x10 + node)));
    }
    fewer.draw();
    assert_ne!(one.1, challenge_of(&fewer.state, 1));
}
