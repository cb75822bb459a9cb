//! Acting and preparing samples: units, the order of cameras, fixed prefix lengths, and scenes that must be refused.

use candle_core::Device;
use zk0_lerobot::config::PolicyConfig;
use zk0_lerobot::dataset::{Normalizer, Stats};
use zk0_smolvla::error::Result;
use zk0_smolvla::frames::sample::{CameraImage, Observation, Pixels, PreparedSample, Preparer};
use zk0_smolvla::policy::init::init_policy;
use zk0_smolvla::policy::model::PolicyParameters;
use zk0_smolvla::policy::profile::Profile;
use zk0_smolvla::policy::tokenizer::WordHash;
use zk0_smolvla::policy::weights::Policy;
use zk0_smolvla::PolicyError;

use crate::actor::{Actor, Scene};

const TASK: &str = "put the cube down";

fn policy(change: impl Fn(&mut PolicyConfig)) -> Policy {
    let mut policy = init_policy(&Profile::Micro.config(), 3).unwrap();
    change(&mut policy.config);
    policy
}

fn stats(mean: f32, std: f32) -> Stats {
    let same = || Normalizer::new(vec![mean; 6], vec![std; 6]).unwrap();
    Stats {
        state: same(),
        action: same(),
    }
}

fn picture(seed: usize) -> Vec<u8> {
    (0..3 * 20 * 30)
        .map(|i| (i * (7 + seed) % 251) as u8)
        .collect()
}

/// `act`, given an actor of the policy with these statistics and 3 Euler steps.
fn with_actor<T>(policy: &Policy, stats: Stats, act: impl Fn(&Actor) -> Result<T>) -> Result<T> {
    let mut all = policy.frozen.clone();
    all.extend(policy.expert.tensors().clone());
    let parameters = PolicyParameters::take(all, &Device::Cpu)?;
    let tokenizer = WordHash::new(&policy.config);
    act(&Actor::new(
        &policy.config,
        &parameters,
        &tokenizer,
        stats,
        3,
    )?)
}

fn cameras<'a>(pictures: &'a [(&'a str, Vec<u8>)]) -> Vec<CameraImage<'a>> {
    let camera = |(name, pixels): &'a (&'a str, Vec<u8>)| CameraImage {
        name,
        height: 20,
        width: 30,
        pixels: Pixels::Bytes(pixels),
    };
    pictures.iter().map(camera).collect()
}

fn chunk(policy: &Policy, stats: Stats, state: &[f32], names: [&str; 2]) -> Result<Vec<f32>> {
    let pictures = [(names[0], picture(0)), (names[1], picture(1))];
    let noise: Vec<f32> = (0..policy.config.chunk_elements())
        .map(|i| (i as f32).sin())
        .collect();
    with_actor(policy, stats.clone(), |actor| {
        let scene = Scene {
            cameras: cameras(&pictures),
            state,
            task: TASK,
        };
        actor.action_chunk(&scene, &noise)
    })
}

fn prepare(policy: &Policy, names: [&str; 2]) -> PreparedSample {
    let pictures = [(names[0], picture(0)), (names[1], picture(1))];
    let c = &policy.config;
    let tokenizer = WordHash::new(c);
    let preparer = Preparer::new(policy, &tokenizer).unwrap();
    let actions = vec![0.5; c.chunk_size * c.action_dim];
    preparer
        .prepare(&Observation {
            cameras: cameras(&pictures),
            state: &[0.1, -0.2, 0.3, -0.4, 0.5, -0.6],
            actions: &actions,
            is_pad: &vec![false; c.chunk_size],
            task: TASK,
        })
        .unwrap()
}

fn worst(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    a.iter()
        .zip(b)
        .map(|(x, y)| (x - y).abs())
        .fold(0.0, f32::max)
}

#[test]
fn states_come_in_and_actions_go_out_in_the_robots_units() {
    let policy = policy(|_| ());
    let state = [10.0, 20.0, -30.0, 0.0, 5.0, 1.0];
    let found = chunk(&policy, stats(2.0, 4.0), &state, ["a", "b"]).unwrap();
    assert_eq!(found.len(), 6 * 6);
    let normalised = state.map(|x| (x - 2.0) / 4.0);
    let plain = chunk(&policy, stats(0.0, 1.0), &normalised, ["a", "b"]).unwrap();
    let expected: Vec<f32> = plain.iter().map(|x| x * 4.0 + 2.0).collect();
    assert!(worst(&found, &expected) < 1e-5);
    // The state matters, and the same scene gives the same bits.
    let again = chunk(&policy, stats(0.0, 1.0), &normalised, ["a", "b"]).unwrap();
    assert_eq!(plain, again);
    let other = chunk(&policy, stats(0.0, 1.0), &state, ["a", "b"]).unwrap();
    assert!(worst(&plain, &other) > 1e-4);
}

#[test]
fn a_policy_that_names_its_cameras_takes_them_in_its_own_order() {
    let named = policy(|c| {
        c.camera_names = ["wrist", "top"]
            .map(|n| format!("observation.images.{n}"))
            .into();
    });
    let nameless = policy(|_| ());
    // By name, camera `a` comes first, so it stands for the policy's first camera, `wrist`.
    let found = prepare(
        &named,
        ["observation.images.wrist", "observation.images.top"],
    );
    assert_eq!(found, prepare(&nameless, ["a", "b"]));
    assert_ne!(
        found,
        prepare(
            &named,
            ["observation.images.top", "observation.images.wrist"]
        )
    );
}

#[test]
fn a_fixed_prefix_length_changes_nothing_that_counts() {
    let free = prepare(&policy(|_| ()), ["a", "b"]);
    let fixed = prepare(&policy(|c| c.prefix_length = 40), ["a", "b"]);
    assert_eq!(free.prefix_tokens, fixed.prefix_tokens);
    for (a, b) in free
        .keys
        .iter()
        .chain(&free.values)
        .zip(fixed.keys.iter().chain(&fixed.values))
    {
        assert!(worst(a, b) < 1e-5);
    }
    let act = |length| {
        let policy = policy(|c| c.prefix_length = length);
        chunk(&policy, stats(0.0, 1.0), &[0.1; 6], ["a", "b"]).unwrap()
    };
    assert!(worst(&act(0), &act(40)) < 1e-5);
}

#[test]
fn scenes_that_do_not_fit_are_refused() {
    let policy = policy(|_| ());
    let refused = |state: &[f32]| {
        let error = chunk(&policy, stats(0.0, 1.0), state, ["a", "b"]).unwrap_err();
        assert!(matches!(error, PolicyError::Sample(_)), "{error}");
    };
    refused(&[0.0; 5]);
    refused(&[0.0, 0.0, f32::NAN, 0.0, 0.0, 0.0]);

    let short = Normalizer::new(vec![0.0; 5], vec![1.0; 5]).unwrap();
    let wrong = Stats {
        state: short,
        ..stats(0.0, 1.0)
    };
    let error = with_actor(&policy, wrong, |_| Ok(())).unwrap_err();
    assert!(matches!(error, PolicyError::Options(_)), "{error}");

    let scene = || Scene {
        cameras: Vec::new(),
        state: &[0.0; 6],
        task: TASK,
    };
    for length in [0, 47, 48] {
        let noise = vec![0.5; length];
        let error = with_actor(&policy, stats(0.0, 1.0), |a| {
            a.action_chunk(&scene(), &noise)
        })
        .unwrap_err();
        let noise_fits = length == policy.config.chunk_elements();
        assert_eq!(error.to_string().contains("cameras"), noise_fits, "{error}");
    }
}
