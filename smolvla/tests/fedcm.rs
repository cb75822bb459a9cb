//! FedCM: each step follows the last global step in part.

use candle_core::{Device, Var};
use std::collections::BTreeMap;
use zk0_smolvla::train::optimizer::{check_alpha, AdamW, AdamWOptions, LastStep, Optimizer};
use zk0_tensors::{TensorData, TensorSet};

const RATE: f64 = 1e-2;
const STEPS: usize = 4;
const START: [f32; 3] = [0.5, -1.0, 0.25];
const EARLIER: [f32; 3] = [0.4, -0.7, 0.25];

fn variables() -> BTreeMap<String, Var> {
    let variable = Var::from_vec(START.to_vec(), 3, &Device::Cpu).unwrap();
    BTreeMap::from([("w".to_string(), variable)])
}

fn earlier() -> TensorSet {
    let data = TensorData {
        shape: vec![3],
        data: EARLIER.to_vec(),
    };
    TensorSet::from([("w".to_string(), data)])
}

fn options() -> AdamWOptions {
    AdamWOptions {
        weight_decay: 0.1,
        ..AdamWOptions::default()
    }
}

/// The weights after each of some steps on the loss Σ w³, with this optimiser of these variables.
fn steps(variables: &BTreeMap<String, Var>, mut optimizer: AdamW) -> Vec<Vec<f32>> {
    let w = &variables["w"];
    let step = |_| {
        let loss = (w.sqr().unwrap() * w.as_tensor()).unwrap().sum_all();
        let gradients = loss.unwrap().backward().unwrap();
        optimizer.step(&gradients, RATE).unwrap();
        w.to_vec1::<f32>().unwrap()
    };
    (0..STEPS).map(step).collect()
}

fn following(alpha: f64, earlier: &TensorSet) -> Vec<Vec<f32>> {
    let variables = variables();
    let mut optimizer = AdamW::new(&variables, options()).unwrap();
    let rates = RATE * STEPS as f64;
    optimizer.follow(LastStep::new(&variables, earlier, alpha, rates).unwrap());
    steps(&variables, optimizer)
}

fn plain() -> Vec<Vec<f32>> {
    let variables = variables();
    let optimizer = AdamW::new(&variables, options()).unwrap();
    steps(&variables, optimizer)
}

#[test]
fn with_alpha_1_steps_have_the_same_bits_as_without_fedcm() {
    assert_eq!(following(1.0, &earlier()), plain());
    assert_ne!(following(0.5, &earlier()), plain());
}

/// Each step is that of the formula, computed here in float64.
#[test]
fn a_step_is_that_of_fedcm() {
    for alpha in [0.1, 0.75] {
        let o = options();
        let (mut w, mut m, mut v) = (START.map(f64::from), [0.0; 3], [0.0; 3]);
        for (step, found) in (1..).zip(following(alpha, &earlier())) {
            let gradient = w.map(|w| 3.0 * w * w);
            let norm = gradient.iter().map(|g| g * g).sum::<f64>().sqrt();
            assert!(norm < o.clip_norm);
            for at in 0..3 {
                let g = gradient[at];
                m[at] = o.beta1 * m[at] + (1.0 - o.beta1) * g;
                v[at] = o.beta2 * v[at] + (1.0 - o.beta2) * g * g;
                let mean = m[at] / (1.0 - o.beta1.powi(step));
                let square: f64 = v[at] / (1.0 - o.beta2.powi(step));
                let own = mean / (square.sqrt() + o.eps);
                let global = f64::from(EARLIER[at] - START[at]) / (RATE * STEPS as f64);
                let decayed = w[at] * (1.0 - RATE * o.weight_decay);
                w[at] = decayed - RATE * (alpha * own + (1.0 - alpha) * global);
                let off = (f64::from(found[at]) - w[at]).abs();
                assert!(off < 1e-6, "step {step}, weight {at}: {off}");
            }
        }
    }
}

/// The steps of a round repeat the part 1 − α of the last global step in all.
#[test]
fn a_round_repeats_a_part_of_the_last_global_step() {
    let variables = variables();
    let w = &variables["w"];
    let options = AdamWOptions {
        weight_decay: 0.0,
        ..options()
    };
    let mut optimizer = AdamW::new(&variables, options).unwrap();
    let last_step = LastStep::new(&variables, &earlier(), 0.25, RATE * STEPS as f64);
    optimizer.follow(last_step.unwrap());
    for _ in 0..STEPS {
        // Without a gradient, the node's own part is 0.
        let nothing = (w.as_tensor() - w.as_detached_tensor()).unwrap();
        let loss = nothing.sqr().unwrap().sum_all().unwrap();
        optimizer.step(&loss.backward().unwrap(), RATE).unwrap();
    }
    let moved = w.to_vec1::<f32>().unwrap();
    for at in 0..3 {
        let expected = START[at] + 0.75 * (START[at] - EARLIER[at]);
        assert!((moved[at] - expected).abs() < 1e-6, "{moved:?}");
    }
}

#[test]
fn what_fedcm_cannot_use_is_named() {
    for alpha in [0.0, -0.5, 1.1, f64::NAN] {
        let why = check_alpha(alpha).unwrap_err().to_string();
        assert!(why.contains("`fedcm_alpha` is"), "{why}");
        assert!(LastStep::new(&variables(), &earlier(), alpha, 1.0).is_err());
    }
    let missing = LastStep::new(&variables(), &TensorSet::new(), 0.5, 1.0).err();
    assert!(missing.unwrap().to_string().contains("'w' is missing"));
}
