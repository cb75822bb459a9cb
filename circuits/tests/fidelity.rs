//! Prints and bounds how close the fixed-point loss is to the real one: |fixed − float64| / float64.

use zk0_circuits::model::arithmetic::tables;
use zk0_circuits::model::draw::draw;
use zk0_circuits::model::eval::{evaluate, Overflow};
use zk0_circuits::model::spec::Dims;
use zk0_circuits::{Digest, EvalSpec};
use zk0_testkit::claims::{quantise, reference, tensors, FloatSample, Random, Tensors};

/// Returns the relative error of the loss over `count` samples, and the worst error of a single sample.
fn fidelity(spec: &EvalSpec, tensors: &Tensors, random: &mut Random, count: usize) -> (f64, f64) {
    let weights = quantise(spec, tensors);
    let scale = (1u64 << spec.action) as f64;
    let (mut fixed, mut real, mut worst) = (0.0, 0.0, 0f64);
    for position in 0..count {
        let prefix = spec.dims.max_prefix as usize - position % 3;
        let parts = FloatSample::random(spec, random, prefix, position % 3);
        let draw = draw(spec, &Digest([position as u8; 32]), 0, 1);
        let sum = evaluate(
            spec,
            &weights,
            &parts.quantise(spec),
            &draw,
            Overflow::Refused,
        )
        .unwrap();
        let noise: Vec<f64> = draw.noise.iter().map(|&n| n as f64 / scale).collect();
        let (expected, elements) = reference::loss(
            &spec.dims,
            tensors,
            &parts,
            &noise,
            draw.time as f64 / 65536.0,
        );
        assert_eq!(sum.elements, elements);
        let got = sum.squared_error as f64 / (scale * scale);
        worst = worst.max((got / expected - 1.0).abs());
        fixed += got;
        real += expected;
    }
    ((fixed / real - 1.0).abs(), worst)
}

#[test]
fn random_micro_models() {
    let spec = EvalSpec::micro();
    let mut random = Random(1);
    for gain in [0.3, 1.0, 1.5] {
        let tensors = tensors(&spec, &mut random, gain);
        let (mean, worst) = fidelity(&spec, &tensors, &mut random, 32);
        println!("micro, gain {gain}: fidelity {mean:.2e}, worst sample {worst:.2e}");
        assert!(mean < 1e-3 && worst < 5e-3);
    }
}

#[test]
fn structured_weights() {
    // A few channels are much larger than the others, as in trained models. This is the worst case for one scale per tensor.
    let spec = EvalSpec::micro();
    let mut random = Random(2);
    let mut tensors = tensors(&spec, &mut random, 0.7);
    for (name, values) in tensors
        .iter_mut()
        .filter(|(name, _)| !name.contains("norm"))
    {
        let every = 7 + name.len() % 5;
        values
            .iter_mut()
            .step_by(every)
            .for_each(|value| *value *= 4.0);
    }
    let (mean, worst) = fidelity(&spec, &tensors, &mut random, 32);
    println!("micro, outlier channels: fidelity {mean:.2e}, worst sample {worst:.2e}");
    assert!(mean < 2e-3 && worst < 1e-2);
}

#[test]
fn other_dimensions() {
    let mut random = Random(3);
    for dims in [
        Dims {
            expert_width: 30,
            expert_mlp: 44,
            heads: 6,
            kv_heads: 3,
            head_dim: 6,
            layers: 5,
            self_attn_every: 3,
            chunk: 5,
            max_action_dim: 9,
            action_dim: 9,
            max_prefix: 21,
        },
        Dims {
            expert_width: 2,
            expert_mlp: 1,
            heads: 1,
            kv_heads: 1,
            head_dim: 2,
            layers: 1,
            self_attn_every: 1,
            chunk: 4,
            max_action_dim: 1,
            action_dim: 1,
            max_prefix: 3,
        },
        Dims {
            expert_width: 96,
            expert_mlp: 256,
            heads: 4,
            kv_heads: 2,
            head_dim: 32,
            layers: 4,
            self_attn_every: 2,
            chunk: 10,
            max_action_dim: 32,
            action_dim: 6,
            max_prefix: 70,
        },
    ] {
        let spec = EvalSpec::new(dims);
        let tensors = tensors(&spec, &mut random, 1.0);
        let (mean, worst) = fidelity(&spec, &tensors, &mut random, 12);
        println!(
            "width {}, {} layers: fidelity {mean:.2e}, worst sample {worst:.2e}",
            dims.expert_width, dims.layers
        );
        assert!(mean < 5e-3 && worst < 3e-2);
    }
}

#[test]
fn tables_are_what_their_formulas_say() {
    let close = |got: i64, bits: u32, expected: f64, ulps: f64| {
        let error = (got as f64 - expected * (1u64 << bits) as f64).abs();
        assert!(
            error <= ulps,
            "{got} is not {expected} with {bits} fraction bits"
        );
    };
    for step in 0..20_000u32 {
        let phase = step.wrapping_mul(0x9e37_79b9);
        let angle = phase as f64 / 4294967296.0 * std::f64::consts::TAU;
        close(
            tables::sine(phase) as i64,
            tables::TRIG_BITS,
            angle.sin(),
            1.0,
        );
        close(
            tables::cosine(phase) as i64,
            tables::TRIG_BITS,
            angle.cos(),
            1.0,
        );
        let x = step as u64;
        close(
            tables::exp2_negative(x) as i64,
            tables::EXP_BITS,
            (-(x as f64) / (1u64 << tables::EXPONENT_BITS) as f64).exp2(),
            0.51,
        );
        let x = step as i64 * 3 - 30_000;
        let logistic = 1.0 / (1.0 + (-(x as f64) / (1u64 << tables::LOGIT_BITS) as f64).exp());
        close(tables::sigmoid(x), tables::SIGMOID_BITS, logistic, 0.51);
    }
}

/// Standard normal distribution function by its power series (Marsaglia 2004).
fn normal_below(x: f64) -> f64 {
    let (mut sum, mut term, mut n) = (x, x, 1.0);
    while term.abs() > 1e-18 {
        n += 2.0;
        term *= x * x / n;
        sum += term;
    }
    0.5 + sum * (-x * x / 2.0).exp() / std::f64::consts::TAU.sqrt()
}

#[test]
fn drawn_noise_and_times_follow_their_distributions() {
    // Every table entry is the quantile that belongs to its index.
    for index in 0..2048u16 {
        let probability = 0.5 + (index as f64 + 0.5) / 4096.0;
        let (low, high) = (
            tables::gaussian(index) as f64 - 0.51,
            tables::gaussian(index) as f64 + 0.51,
        );
        let scale = (1u64 << tables::GAUSS_BITS) as f64;
        assert!(
            normal_below(low / scale) < probability && probability < normal_below(high / scale)
        );
        assert_eq!(tables::gaussian(index | 0x800), -tables::gaussian(index));
    }
    for index in 0..4096u16 {
        let time = 0.999 * ((index as f64 + 0.5) / 4096.0).powf(2.0 / 3.0) + 0.001;
        assert!((tables::flow_time(index) as f64 - time * 65536.0).abs() <= 0.51);
    }
    let spec = EvalSpec::micro();
    let (mut squares, mut sum, mut count) = (0.0, 0.0, 0);
    for position in 0..500 {
        let draw = draw(&spec, &Digest([9; 32]), position, 500);
        assert_eq!(draw.noise.len(), 48);
        for noise in draw.noise {
            let noise = noise as f64 / (1u64 << spec.action) as f64;
            (squares, sum, count) = (squares + noise * noise, sum + noise, count + 1);
        }
    }
    let (mean, variance) = (sum / count as f64, squares / count as f64);
    assert!(
        mean.abs() < 0.03 && (variance - 1.0).abs() < 0.04,
        "mean {mean}, variance {variance}"
    );
}
