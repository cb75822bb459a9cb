//! Arguments open samples. They are counted on disk before they are made, and a sample that is worn out is opened no more.

use std::collections::HashMap;
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use tempfile::TempDir;
use zk0_argument::claim::most_uses;
use zk0_circuits::{Mode, QuantisedWeights};
use zk0_node::error::ParticipantError;
use zk0_node::recording::opened_samples::OpenedSamples;
use zk0_node::recording::secret::{count, Secrets};
use zk0_node::recording::OpenRecording;
use zk0_node::turn::prepared_claim::prepare;
use zk0_prover::program::PreparedClaim;
use zk0_testkit::micro_network::{pickplace, Setting, SECRET};

/// A state folder with the secret of a registration.
fn state() -> TempDir {
    let state = tempfile::tempdir().unwrap();
    let mut secrets = Secrets::default();
    secrets.add(SECRET);
    secrets.keep(state.path()).unwrap();
    state
}

fn file(state: &TempDir) -> Vec<u8> {
    fs::read(Secrets::path(state.path())).unwrap()
}

/// The file is all that a node remembers, so each count here is that of a node that was started again.
#[test]
fn a_node_with_a_limit_of_2_uses_refuses_the_third() {
    let state = state();
    let count = |leaves: &[u64]| count(state.path(), &SECRET, leaves, 2);
    count(&[3, 5]).unwrap();
    count(&[5, 9]).unwrap();
    let before = file(&state);
    match count(&[3, 5]) {
        Err(ParticipantError::WornOut { leaf, opened, .. }) => assert_eq!((leaf, opened), (5, 2)),
        other => panic!("{other:?}"),
    }
    assert_eq!(file(&state), before, "a refused argument was counted");
    count(&[3, 9]).unwrap();
    assert!(count(&[3]).is_err() && count(&[9]).is_err());
    let mode = fs::metadata(Secrets::path(state.path())).unwrap();
    assert_eq!(mode.permissions().mode() & 0o777, 0o600);
}

#[test]
fn a_secret_is_worn_when_a_leaf_has_come_to_four_fifths() {
    let state = state();
    let is_worn = || {
        let secrets = Secrets::read(state.path()).unwrap().unwrap();
        secrets.is_worn(&SECRET, 10)
    };
    for _ in 0..7 {
        count(state.path(), &SECRET, &[1, 2], 10).unwrap();
    }
    assert!(!is_worn());
    count(state.path(), &SECRET, &[2], 10).unwrap();
    assert!(is_worn());
}

/// The policy's weights, with velocities so many times as large.
fn louder(setting: &Setting, by: f32) -> QuantisedWeights {
    let tensors = setting.file.policy.expert.tensors().iter();
    let louder: HashMap<_, Vec<f32>> = tensors
        .map(|(name, tensor)| {
            let by = if name.contains("action_out_proj") {
                by
            } else {
                1.0
            };
            (
                name.clone(),
                tensor.data.iter().map(|value| value * by).collect(),
            )
        })
        .collect();
    let find = |name: &str| louder.get(name).map(Vec::as_slice);
    QuantisedWeights::quantise(&setting.spec, find).unwrap()
}

/// A claim about all samples of a small evaluation set, in mode `succinct`. Its base saturates if it is to hold, and is worse than its update.
fn input(state: &Path, holds: bool) -> OpenedSamples {
    let mut setting = Setting::new();
    setting.mode = Mode::Succinct;
    let recording = OpenRecording::open(&pickplace(), &setting.policy(), None).unwrap();
    let maker = recording.maker();
    let samples = recording.samples(&maker);
    let set = setting.set(&recording, &samples, &state.join("samples"), 8);
    let expected = setting.expected(&set, 0, 8);
    let [base, update] = [if holds { 16.0 } else { 1.0 }, 1.0].map(|by| louder(&setting, by));
    set.private_input(&samples, &expected, base, update)
        .unwrap()
}

/// What a node does that comes to this claim. The argument is lost when this returns, as that of a node that is killed before it sends it.
async fn prepared(
    state: &TempDir,
    input: &OpenedSamples,
) -> Result<PreparedClaim, ParticipantError> {
    prepare(Mode::Succinct, input.clone(), SECRET, state.path().into()).await
}

#[tokio::test]
async fn an_argument_that_was_never_sent_is_counted() {
    let state = state();
    let input = input(state.path(), true);
    let all: Vec<_> = (0..8).collect();
    let most = most_uses(&Setting::new().spec);
    for _ in 0..most - 2 {
        count(state.path(), &SECRET, &all, most).unwrap();
    }
    for _ in 0..2 {
        prepared(&state, &input).await.unwrap();
    }
    let refused = prepared(&state, &input).await.unwrap_err();
    let ParticipantError::WornOut { opened, .. } = refused else {
        panic!("{refused}");
    };
    assert_eq!(opened, most);
    let reported = refused.to_string();
    assert!(
        reported.contains("registers its recording again by itself"),
        "{reported}"
    );
}

/// Nobody knows what became of an argument that failed, so it counts before it is begun.
#[tokio::test]
async fn an_argument_is_counted_before_it_is_made() {
    let state = state();
    let input = input(state.path(), false);
    let error = prepared(&state, &input).await.unwrap_err();
    assert!(matches!(error, ParticipantError::NotProvable(_)), "{error}");
    let counted = file(&state);
    let mut once = Secrets::default();
    once.add(SECRET);
    once.keep(state.path()).unwrap();
    let all: Vec<_> = (0..8).collect();
    count(state.path(), &SECRET, &all, 1).unwrap();
    assert_eq!(counted, file(&state));
}

/// In mode `direct` samples are in the private input anyway.
#[tokio::test]
async fn nothing_is_counted_in_mode_direct() {
    let state = state();
    let before = file(&state);
    let input = input(state.path(), false);
    let error = prepare(Mode::Direct, input, SECRET, state.path().into()).await;
    assert!(matches!(error, Err(ParticipantError::NotProvable(_))));
    assert_eq!(file(&state), before);
}

#[tokio::test]
async fn a_lost_or_damaged_file_stops_the_argument_and_stays_as_it_is() {
    let state = state();
    let input = input(state.path(), true);
    let good = file(&state);
    let path = Secrets::path(state.path());
    let mut another = Secrets::default();
    another.add(zk0_node::recording::secret::RegistrationSecret::new(
        [9; 32],
    ));
    let mut flipped = good.clone();
    flipped[30] ^= 1;
    let mut longer = good.clone();
    longer.push(0);
    for (bytes, why) in [
        (Some(flipped), "is damaged: its checksum is wrong"),
        (Some(longer), "is damaged: its checksum is wrong"),
        (
            Some(good[..good.len() - 1].to_vec()),
            "is damaged: its checksum is wrong",
        ),
        (
            Some(good[..20].to_vec()),
            "is damaged: it is cut off after 20 bytes",
        ),
        (Some(vec![]), "is damaged: it does not begin"),
        (Some(vec![0; 17 << 20]), "is damaged: it has more than"),
        (
            Some(another.encode()),
            "does not have the secret of the registered dataset",
        ),
        (None, "is not there any more"),
    ] {
        match &bytes {
            Some(bytes) => fs::write(&path, bytes).unwrap(),
            None => fs::remove_file(&path).unwrap(),
        }
        let reported = prepared(&state, &input).await.unwrap_err().to_string();
        assert!(reported.contains(why), "{reported}");
        assert!(
            reported.contains("move the files `secret` and `registration` out of"),
            "{reported}"
        );
        assert_eq!(fs::read(&path).ok(), bytes, "it was overwritten");
    }
}
