//! LeRobot's tiny policy in fixed point: losses as close to float32 as promised, ranges chosen from data with the promised
//! headroom, and errors that name the place where a value does not fit.

use std::sync::LazyLock;

use zk0_circuits::model::quantise::QuantiseError;
use zk0_circuits::model::spec::Dims;
use zk0_circuits::{Digest, EvalSpec};
use zk0_lerobot::dataset::Dataset;
use zk0_smolvla::frames::sample::{PreparedSample, Preparer};
use zk0_smolvla::measure::calibrate::{
    calibrate, ranges, CalibrateError, CalibrationPoint, Magnitudes,
};
use zk0_smolvla::measure::fidelity::{draws, measure, Fidelity, FidelityError};
use zk0_smolvla::measure::fixed_point::dims;
use zk0_smolvla::policy::model::observe::Site;
use zk0_smolvla::policy::profile::Profile;
use zk0_smolvla::policy::tokenizer::WordHash;
use zk0_smolvla::policy::weights::ExpertWeights;
use zk0_smolvla::train::{train, TrainOptions};
use zk0_smolvla::PolicyError;

use crate::reference::{config, fixtures, policy};

/// What the project promises: 0.5 % of the mean loss.
const PROMISE: f64 = 5e-3;
const CALIBRATION: Digest = Digest([1; 32]);
const COMPARISON: Digest = Digest([2; 32]);

/// Samples to train and calibrate on, and between them other samples to compare on.
static SAMPLES: LazyLock<[Vec<PreparedSample>; 2]> = LazyLock::new(|| {
    let mut policy = policy();
    // The recording's cameras have other names.
    policy.config.camera_names.clear();
    let tokenizer = WordHash::new(&policy.config);
    let preparer = Preparer::new(&policy, &tokenizer).unwrap();
    let dataset = Dataset::open(fixtures().join("datasets/so100_pickplace")).unwrap();
    let every_third = (0..dataset.len()).step_by(3);
    let all = preparer.prepare_frames(&dataset, every_third, |_, _| ());
    let all = all.unwrap();
    let every_other = |first: usize| all.iter().skip(first).step_by(2).cloned().collect();
    [every_other(0), every_other(1)]
});

fn magnitudes(weights: &ExpertWeights) -> Magnitudes {
    let [ours, _] = &*SAMPLES;
    let spec = EvalSpec::new(dims(&config()).unwrap());
    let draws = draws(&spec, &CALIBRATION, 2 * ours.len());
    let pairs: Vec<_> = ours.iter().cycle().zip(&draws).collect();
    Magnitudes::observe(&config(), weights, &pairs).unwrap().0
}

fn compare(spec: &EvalSpec, weights: &ExpertWeights) -> Result<Fidelity, FidelityError> {
    let [_, others] = &*SAMPLES;
    measure(spec, &config(), weights, others, &COMPARISON, others.len())
}

fn trained() -> ExpertWeights {
    let options = TrainOptions {
        steps: 120,
        batch_size: 16,
        learning_rate: 2e-3,
        seed: 1,
        ..TrainOptions::default()
    };
    let [ours, _] = &*SAMPLES;
    train(&config(), &policy().expert, ours, &options, &mut |_| ())
        .unwrap()
        .weights
}

/// Returns the policy's weights, with those of some tensors multiplied.
fn stretched(tensors: &[&str], factor: f32) -> ExpertWeights {
    let mut all = policy().expert.into_tensors();
    for tensor in tensors {
        let tensor = all.get_mut(*tensor).unwrap();
        tensor.data.iter_mut().for_each(|value| *value *= factor);
    }
    ExpertWeights::from_tensors(&config(), all).unwrap()
}

const LAYER: &str = "model.vlm_with_expert.lm_expert.layers";

#[test]
fn fixed_point_losses_are_within_the_promise() {
    let (untrained, trained) = (policy().expert, trained());
    let dims = dims(&config()).unwrap();
    let default = EvalSpec::new(dims);
    let calibrated = calibrate(dims, &magnitudes(&untrained)).unwrap();
    let mut losses = Vec::new();
    for (state, weights) in [("untrained", &untrained), ("trained", &trained)] {
        for (name, spec) in [("default", &default), ("calibrated", &calibrated)] {
            let fidelity = compare(spec, weights).unwrap();
            let difference = fidelity.relative_difference();
            println!(
                "{state}, {name} ranges: float32 {:.6}, fixed point {:.6}, difference {difference:.2e}, worst sample {:.2e}",
                fidelity.float32_loss, fidelity.fixed_point_loss, fidelity.worst_sample
            );
            assert!(
                difference <= PROMISE,
                "{state}, {name} ranges: {difference}"
            );
            losses.push(fidelity.float32_loss);
        }
    }
    assert!(losses[2] < 0.8 * losses[0], "it has learnt: {losses:?}");
}

#[test]
fn calibrated_ranges_have_the_promised_headroom_and_no_bit_more_than_that() {
    let weights = policy().expert;
    let seen = magnitudes(&weights);
    let spec = calibrate(dims(&config()).unwrap(), &seen).unwrap();
    let held = ranges(&spec, &seen);
    // Ten places belong to no layer. A self-attention layer has eighteen places. The other layers have one less, because they do
    // not rotate keys.
    let layers = spec.dims.layers as usize;
    assert_eq!(held.len(), 10 + 2 * 18 + 2 * 17, "every place is there");
    for range in &held {
        assert!(range.headroom() >= 8.0, "{range:?}");
    }
    // With one more bit for any of the scales, one of its places would lose the headroom.
    let tightest = |of: &dyn Fn(CalibrationPoint) -> bool| {
        let held = held.iter().filter(|range| of(range.place));
        held.map(|range| range.headroom()).fold(f64::MAX, f64::min)
    };
    for layer in 0..layers {
        for sites in [
            vec![Site::InputNorm(layer)],
            vec![Site::Query(layer), Site::RotatedQuery(layer)],
            vec![Site::AttentionOut(layer), Site::Attended(layer)],
            vec![Site::MlpNorm(layer)],
            vec![Site::Up(layer)],
            vec![Site::Gated(layer)],
            vec![Site::Down(layer), Site::MlpOut(layer)],
        ] {
            let headroom = tightest(&|place| {
                sites
                    .iter()
                    .any(|site| place == CalibrationPoint::Evaluation(*site))
            });
            assert!(headroom < 16.0, "{sites:?}: {headroom}");
        }
    }
}

#[test]
fn weights_out_of_range_are_an_error_that_names_the_layer() {
    let dims = dims(&config()).unwrap();
    let spec = calibrate(dims, &magnitudes(&policy().expert)).unwrap();
    for (tensor, place) in [
        ("model.action_in_proj.weight".into(), "action_in_proj"),
        (
            format!("{LAYER}.0.self_attn.k_proj.weight"),
            "layer 0 k_proj",
        ),
        (
            format!("{LAYER}.1.self_attn.v_proj.weight"),
            "layer 1 v_proj",
        ),
        (
            format!("{LAYER}.2.self_attn.q_proj.weight"),
            "layer 2 q_proj",
        ),
        (
            format!("{LAYER}.2.input_layernorm.weight"),
            "layer 2 input_layernorm",
        ),
        (
            format!("{LAYER}.3.mlp.gate_proj.weight"),
            "layer 3 gate_proj",
        ),
        (
            format!("{LAYER}.3.mlp.down_proj.weight"),
            "layer 3 down_proj",
        ),
        (
            "model.action_out_proj.weight".into(),
            "velocity (action_out_proj)",
        ),
    ] {
        let weights = stretched(&[&tensor], 200.0);
        let error = compare(&spec, &weights).unwrap_err();
        assert!(matches!(error, FidelityError::Evaluation(_)), "{error}");
        let error = error.to_string();
        assert!(
            error.starts_with(&format!("{place}: ")),
            "{tensor}: {error}"
        );
    }
    // The weight is larger than any scale can hold, so it is refused before any evaluation.
    let tensor = format!("{LAYER}.1.mlp.up_proj.weight");
    let error = compare(&spec, &stretched(&[&tensor], 1e7)).unwrap_err();
    match error {
        FidelityError::Quantise(QuantiseError::TooLarge { name, .. }) => assert_eq!(name, tensor),
        error => panic!("{error}"),
    }
}

#[test]
fn ranges_follow_the_data() {
    // The queries and keys are too large for the default ranges, but not for ranges that are chosen from them.
    let (queries, keys) = (
        format!("{LAYER}.2.self_attn.q_proj.weight"),
        format!("{LAYER}.1.self_attn.k_proj.weight"),
    );
    let weights = stretched(&[&queries, &keys], 60.0);
    let dims = dims(&config()).unwrap();
    let error = compare(&EvalSpec::new(dims), &weights).unwrap_err();
    assert!(matches!(error, FidelityError::Evaluation(_)), "{error}");
    let spec = calibrate(dims, &magnitudes(&weights)).unwrap();
    let difference = compare(&spec, &weights).unwrap().relative_difference();
    println!("large queries and keys: difference {difference:.2e}");
    assert!(difference <= PROMISE, "{difference}");
}

#[test]
fn values_that_no_range_holds_are_refused_by_name() {
    let dims = dims(&config()).unwrap();
    let up = format!("{LAYER}.3.mlp.up_proj.weight");
    let error = calibrate(dims, &magnitudes(&stretched(&[&up], 1e6))).unwrap_err();
    match &error {
        CalibrateError::TooLarge { place, limit, .. } => {
            assert_eq!(*place, CalibrationPoint::Evaluation(Site::Up(3)));
            assert_eq!(*limit, 32767.0 / 8.0);
        }
        error => panic!("{error}"),
    }
    assert!(error
        .to_string()
        .starts_with("layer 3 up_proj: values reach"));
}

#[test]
fn nothing_to_compare_is_an_error() {
    let spec = EvalSpec::new(dims(&config()).unwrap());
    let weights = policy().expert;
    let measured = measure(&spec, &config(), &weights, &[], &COMPARISON, 4);
    assert!(matches!(
        measured,
        Err(FidelityError::Policy(PolicyError::Sample(_)))
    ));
}

#[test]
fn dimensions_follow_from_the_configuration() {
    let of = |profile: Profile| dims(&profile.config()).unwrap();
    assert_eq!(of(Profile::Micro), Dims::MICRO);
    assert_eq!(of(Profile::Full), Dims::FULL);
    let mut other = Profile::Micro.config();
    other.max_period = 8.0;
    assert!(dims(&other).unwrap_err().to_string().contains("periods"));
    let mut wide = Profile::Micro.config();
    wide.expert.width = 1 << 15;
    assert!(dims(&wide)
        .unwrap_err()
        .to_string()
        .contains("expert_width"));
}
