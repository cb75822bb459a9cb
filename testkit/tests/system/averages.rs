//! The result of a real round is the average of what the ledger accepted, and of nothing else.

use crate::real_ledger::{all_accepted, ledger_copy};
use std::fs;
use std::io::sink;
use tempfile::TempDir;
use zk0_aggregator::round::closing::ToClose;
use zk0_audit::account::CheckKind;
use zk0_audit::checks::closings::average;
use zk0_audit::checks::pruning_waiver::PruningWaiver;
use zk0_audit::checks::Check;
use zk0_audit::verified_entries::verified_entries;
use zk0_audit::Depth;
use zk0_circuits::{Digest, WeightsDigest};
use zk0_ledger::blobs::Blobs;
use zk0_protocol::entries::entry::{Body, Entry, MomentsComputed, RoundClosed, ENTRY_VERSION};
use zk0_protocol::rules::closing::server_moments::ServerMoments;
use zk0_protocol::rules::network_rules::Strategy;
use zk0_protocol::{Refusal, RefusalCode, State};
use zk0_verifier::close::{combined, CloseError};
use zk0_verifier::combine::bases::BaseError;
use zk0_verifier::combine::error::CombineError;
use zk0_verifier::{authenticate, verify, BaseFiles, UnverifiedContribution, VerifiedContribution};

/// The state before the first round of the real ledger closed, what the round accepted, and how it closed.
fn round() -> (TempDir, State, Vec<VerifiedContribution>, RoundClosed) {
    let dir = ledger_copy();
    let real = all_accepted(dir.path());
    let mut state = real[0].state.clone();
    let first = real[0].index as usize;
    let contributions = real.into_iter().map(|accepted| {
        let UnverifiedContribution {
            submission,
            proof,
            weights,
        } = accepted.contribution;
        let node = submission.statement.claim.terms.node;
        let context = accepted.state.claim_context(&node);
        let authentic = authenticate(submission, proof, &context).unwrap();
        verify(&authentic, &weights, &context, accepted.time_ms).unwrap()
    });
    let contributions = contributions.collect();
    let (entries, _) = verified_entries(dir.path()).unwrap();
    for entry in &entries[first..] {
        if let Body::RoundClosed(closed) = &entry.body {
            return (dir, state, contributions, closed.clone());
        }
        state.apply(&Digest::default(), entry).unwrap();
    }
    panic!("the round did not close");
}

#[test]
fn another_result_than_the_average_is_a_fault() {
    let (dir, state, contributions, closed) = round();
    let blobs = Blobs::at(dir.path());
    assert!(average(
        &state,
        &closed,
        &contributions,
        Depth::Full,
        PruningWaiver::default(),
        &blobs
    )
    .is_ok());
    let mut other = closed;
    match &mut other.evaluated {
        Some(evaluated) => evaluated.weights.quantised.0[0] ^= 1,
        None => other.global.quantised.0[0] ^= 1,
    }
    match average(
        &state,
        &other,
        &contributions,
        Depth::Full,
        PruningWaiver::default(),
        &blobs,
    ) {
        Err(Check::Failed(why)) => assert!(why.contains("but its contributions give"), "{why}"),
        found => panic!("not found: {found:?}"),
    }
}

#[test]
fn only_what_the_ledger_accepted_is_averaged() {
    let (dir, state, contributions, _) = round();
    assert!(contributions.len() > 1, "the fixture's round averages");
    let given = |contributions: &[VerifiedContribution]| {
        let blobs = Blobs::at(dir.path());
        let read_at = |digest: &_, place, buffer: &mut [u8]| blobs.read_at(digest, place, buffer);
        combined(
            &state,
            contributions,
            &BaseFiles::default(),
            read_at,
            &mut sink(),
        )
    };
    assert!(given(&contributions).is_ok());
    let (one, others) = contributions.split_first().unwrap();
    let twice = [vec![one.clone(); 2], others[1..].to_vec()].concat();
    for others in [vec![], others.to_vec(), twice] {
        let refused = given(&others).unwrap_err();
        assert!(
            matches!(refused, CloseError::OtherContributions { .. }),
            "{refused}"
        );
    }
}

/// The files are read again when the round closes. What a disk gives back then need not be what was verified.
#[test]
fn an_update_that_changed_on_disk_after_its_verification_is_not_averaged() {
    let (dir, state, contributions, closed) = round();
    let blobs = Blobs::at(dir.path());
    let update = contributions[0].claim().terms.update.blob;
    let (path, whole) = (blobs.path(&update), fs::read(blobs.path(&update)).unwrap());
    let combined = || {
        let read_at = |digest: &_, place, buffer: &mut [u8]| blobs.read_at(digest, place, buffer);
        combined(
            &state,
            &contributions,
            &BaseFiles::default(),
            read_at,
            &mut sink(),
        )
    };
    assert!(combined().is_ok());
    let mut changed = whole.clone();
    *changed.last_mut().unwrap() ^= 1;
    fs::write(&path, &changed).unwrap();
    match combined() {
        Err(CloseError::Combine(CombineError::Changed { blob, tensor })) => {
            assert_eq!((blob, &tensor[..]), (update, "model.action_out_proj.bias"));
        }
        found => panic!("{found:?}"),
    }
    match average(
        &state,
        &closed,
        &contributions,
        Depth::Full,
        PruningWaiver::default(),
        &blobs,
    ) {
        Err(Check::Damaged(blob, why)) => {
            assert_eq!(blob, update);
            assert!(why.contains("has changed since"), "{why}");
        }
        found => panic!("{found:?}"),
    }
    fs::write(&path, &whole[..whole.len() - 1]).unwrap();
    let short = combined().unwrap_err();
    assert!(short.to_string().contains("cannot be read"), "{short}");
    fs::write(&path, &whole).unwrap();
    assert!(combined().is_ok());
}

/// The state with another strategy, in a round that follows on one that started from `earlier`, and from these moments.
fn with_strategy(
    state: &State,
    strategy: Strategy,
    earlier: Option<WeightsDigest>,
    moments: Option<ServerMoments>,
) -> State {
    let mut bytes = borsh::to_vec(state).unwrap();
    // The last fields state what the round before started from, the moments, and the log's keys. Before the first round there is neither of the first two.
    let keys = borsh::to_vec(state.log_keys()).unwrap();
    assert!(bytes.ends_with(&keys));
    bytes.truncate(bytes.len() - keys.len());
    assert_eq!((state.moments(), bytes.pop()), (None, Some(0)));
    assert_eq!((state.earlier_base(), bytes.pop()), (None, Some(0)));
    bytes.extend(borsh::to_vec(&(earlier, moments)).unwrap());
    bytes.extend(keys);
    let rules = state.rules();
    let (before, mut after) = (borsh::to_vec(rules).unwrap(), rules.clone());
    after.strategy = strategy;
    let after = borsh::to_vec(&after).unwrap();
    // The rules in force stand behind those of the genesis and before those of the round.
    let mut places = (0..bytes.len()).filter(|at| bytes[*at..].starts_with(&before));
    let place = places.nth(1).unwrap();
    bytes.splice(place..place + before.len(), after);
    borsh::from_slice(&bytes).unwrap()
}

#[test]
fn momentum_reads_the_base_of_the_round_before() {
    let (dir, state, contributions, mut closed) = round();
    let blobs = Blobs::at(dir.path());
    let strategy = Strategy::FedAvgM {
        server_rate_bps: 8000,
        momentum_bps: 5000,
    };
    // Any weights of the network will do.
    let earlier = contributions[1].claim().terms.update;
    let state = with_strategy(&state, strategy, Some(earlier), None);
    let files = || BaseFiles::read(&state, |digest, limit| blobs.get(digest, limit));
    let read_at = |digest: &_, place, buffer: &mut [u8]| blobs.read_at(digest, place, buffer);
    let bases = files().unwrap();
    let result = combined(&state, &contributions, &bases, read_at, &mut sink())
        .unwrap()
        .unwrap();
    match &mut closed.evaluated {
        Some(evaluated) => evaluated.weights = result.digest,
        None => closed.global = result.digest,
    }
    let audited = || {
        average(
            &state,
            &closed,
            &contributions,
            Depth::Full,
            PruningWaiver::default(),
            &blobs,
        )
    };
    assert_eq!(audited().unwrap(), Some(result));
    // It is not left out where nobody gave the file.
    let without = BaseFiles {
        earlier: None,
        ..bases.clone()
    };
    let refused = combined(&state, &contributions, &without, read_at, &mut sink());
    let not_given = BaseError::NotGiven(earlier.blob);
    assert_eq!(refused, Err(CloseError::Base(not_given)));
    // Other weights than the ledger names are refused, although they are weights of the network.
    let other = BaseFiles {
        earlier: bases.base.clone(),
        ..bases
    };
    match combined(&state, &contributions, &other, read_at, &mut sink()) {
        Err(CloseError::Base(BaseError::Other(Refusal {
            code: RefusalCode::UpdateDigest { expected, .. },
            ..
        }))) => {
            assert_eq!(expected, earlier.blob);
        }
        found => panic!("{found:?}"),
    }

    // The audit needs the file: without it the average is not checked, and with another one in its place something is wrong.
    let base = state.round().unwrap().opened.base.blob;
    for blob in [base, earlier.blob] {
        let path = blobs.path(&blob);
        let whole = fs::read(&path).unwrap();
        fs::remove_file(&path).unwrap();
        match audited() {
            Err(Check::NotAtHand(CheckKind::Averages, _, why)) => {
                assert!(why.contains(&blob.to_string()), "{why}");
            }
            found => panic!("{found:?}"),
        }
        fs::write(&path, b"something else").unwrap();
        assert!(matches!(audited(), Err(Check::Damaged(found, _)) if found == blob));
        fs::write(&path, whole).unwrap();
    }
}

const FED_ADAM: Strategy = Strategy::FedAdam {
    server_rate_billionths: 1_000_000,
    beta1_bps: 9000,
    beta2_bps: 9900,
    tau_billionths: 1_000_000,
};

/// The state after an entry that names these moments of its open round, at the end of the round.
fn naming(state: &State, moments: Digest) -> State {
    let mut state = state.clone();
    let round = state.round().unwrap();
    let computed = Entry {
        version: ENTRY_VERSION,
        time_ms: state
            .time_ms()
            .max(round.randomness.unwrap().submit_deadline_ms + 1),
        body: Body::MomentsComputed(MomentsComputed {
            round: round.number(),
            moments,
        }),
    };
    state.apply(&Digest::default(), &computed).unwrap();
    state
}

/// What the round closes with by FedAdam, the state that names its moments, and the file of the moments.
fn by_fed_adam(
    state: &State,
    contributions: &[VerifiedContribution],
    closed: &RoundClosed,
    blobs: &Blobs,
) -> (RoundClosed, State, Vec<u8>) {
    let bases = BaseFiles::read(state, |digest, limit| blobs.get(digest, limit)).unwrap();
    let read_at = |digest: &_, place, buffer: &mut [u8]| blobs.read_at(digest, place, buffer);
    let mut file = Vec::new();
    let result = combined(state, contributions, &bases, read_at, &mut file);
    let result = result.unwrap().unwrap();
    let mut closed = closed.clone();
    match &mut closed.evaluated {
        Some(evaluated) => evaluated.weights = result.digest,
        None => closed.global = result.digest,
    }
    (closed, naming(state, result.moments.unwrap()), file)
}

#[test]
fn other_moments_than_those_of_the_round_are_a_fault() {
    let (dir, state, contributions, closed) = round();
    let blobs = Blobs::at(dir.path());
    let state = with_strategy(&state, FED_ADAM, None, None);
    let (closed, named, _) = by_fed_adam(&state, &contributions, &closed, &blobs);
    assert!(closed.is_taken());
    assert!(average(
        &named,
        &closed,
        &contributions,
        Depth::Full,
        PruningWaiver::default(),
        &blobs
    )
    .is_ok());
    let other = naming(&state, Digest([3; 32]));
    // A ledger whose rules were not kept has none at all.
    for false_state in [other, state] {
        match average(
            &false_state,
            &closed,
            &contributions,
            Depth::Full,
            PruningWaiver::default(),
            &blobs,
        ) {
            Err(Check::Failed(why)) => assert!(why.contains("closed with the moments"), "{why}"),
            found => panic!("not found: {found:?}"),
        }
    }
}

#[test]
fn an_audit_reads_the_moments_that_the_round_goes_on_from() {
    let (dir, state, contributions, closed) = round();
    let blobs = Blobs::at(dir.path());
    let first = with_strategy(&state, FED_ADAM, None, None);
    let (first, _, file) = by_fed_adam(&first, &contributions, &closed, &blobs);
    let blob = blobs.put(&file).unwrap();
    let moments = ServerMoments { blob, steps: 1 };
    let second = with_strategy(&state, FED_ADAM, None, Some(moments));
    let (second, named, _) = by_fed_adam(&second, &contributions, &closed, &blobs);
    assert_ne!(first.evaluated, second.evaluated, "the moments count");
    let audited = || {
        average(
            &named,
            &second,
            &contributions,
            Depth::Full,
            PruningWaiver::default(),
            &blobs,
        )
    };
    assert!(audited().is_ok());
    // The aggregator keeps the file of the moments among the blobs.
    let computed = |state: &State| {
        let to_close = ToClose {
            state: state.clone(),
            contributions: contributions.clone(),
            lost: Vec::new(),
            accepted: Vec::new(),
            blobs: blobs.clone(),
            dir: dir.path().into(),
        };
        to_close.compute().unwrap()
    };
    let state = with_strategy(&state, FED_ADAM, None, Some(moments));
    let closing = computed(&state).map_err(drop).unwrap().closing;
    assert_eq!(
        closing.closed.evaluated.map(|one| one.weights),
        second.evaluated.as_ref().map(|one| one.weights)
    );
    let later = closing.moments.unwrap();
    assert_eq!(Some(later), named.round().unwrap().moments);
    blobs.check(&later).unwrap();
    // Without the file the average is not checked, and with another one in its place something is wrong.
    let path = blobs.path(&blob);
    fs::remove_file(&path).unwrap();
    match audited() {
        Err(Check::NotAtHand(CheckKind::Averages, _, why)) => {
            assert!(why.contains(&blob.to_string()), "{why}");
        }
        found => panic!("{found:?}"),
    }
    // Nor can the round close.
    let why = computed(&state).err().unwrap();
    assert!(
        why.contains(&blob.to_string()) && why.contains("put the file back"),
        "{why}"
    );
    let mut changed = file;
    *changed.last_mut().unwrap() ^= 1;
    fs::write(&path, &changed).unwrap();
    match audited() {
        Err(Check::Damaged(found, why)) => {
            assert_eq!(found, blob);
            assert!(why.contains("the ledger names"), "{why}");
        }
        found => panic!("{found:?}"),
    }
}

#[test]
fn a_round_waits_while_its_result_cannot_be_kept() {
    let (dir, state, contributions, closed) = round();
    let blobs = Blobs::at(dir.path());
    fs::remove_file(blobs.path(&closed.global.blob)).unwrap();
    // With a file in place of the folder for what is unfinished, nothing can be written.
    let unfinished = dir.path().join("blobs/unfinished");
    let _ = fs::remove_dir_all(&unfinished);
    fs::write(&unfinished, "").unwrap();
    let with_moments = with_strategy(&state, FED_ADAM, None, None);
    for state in [&state, &with_moments] {
        let compute = || {
            let to_close = ToClose {
                state: state.clone(),
                contributions: contributions.clone(),
                lost: Vec::new(),
                accepted: Vec::new(),
                blobs: blobs.clone(),
                dir: dir.path().into(),
            };
            to_close.compute().unwrap()
        };
        let why = compute().map(drop).unwrap_err();
        assert!(why.contains("its result cannot be kept"), "{why}");
        fs::remove_file(&unfinished).unwrap();
        assert!(compute().is_ok());
        let _ = fs::remove_dir_all(&unfinished);
        fs::write(&unfinished, "").unwrap();
    }
}
