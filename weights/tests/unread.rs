//! Which weights the evaluation does not read, found by changing each of them.

use std::collections::BTreeSet;
use zk0_circuits::model::draw::Draw;
use zk0_circuits::model::eval::{evaluate, Overflow};
use zk0_circuits::model::sample::SampleParts;
use zk0_circuits::{EvalSpec, QuantisedWeights, Sample};
use zk0_weights::{Format, ScaledTensor, WeightFileError};

fn sample(spec: &EvalSpec) -> Sample {
    let dims = &spec.dims;
    let prefix = 5 * dims.kv_width();
    let cache = |salt: usize| -> Vec<f32> {
        (0..prefix)
            .map(|at| ((at * 31 + salt) % 17) as f32 / 8.0 - 1.0)
            .collect()
    };
    let (keys, values) = (cache(3), cache(7));
    let cache: Vec<_> = (0..dims.layers).map(|_| (&keys[..], &values[..])).collect();
    let actions = (dims.chunk * dims.max_action_dim) as usize;
    let actions: Vec<f32> = (0..actions).map(|at| (at % 7) as f32 / 3.0 - 1.0).collect();
    let is_pad = vec![false; dims.chunk as usize];
    let parts = SampleParts {
        cache: &cache,
        actions: &actions,
        is_pad: &is_pad,
    };
    Sample::quantise(spec, parts).unwrap()
}

/// Several times and noises. At one alone, an input of some weight may be zero.
fn draws(spec: &EvalSpec) -> Vec<Draw> {
    let values = (spec.dims.chunk * spec.dims.max_action_dim) as i32;
    (1..9)
        .map(|number| Draw {
            time: 7_001 * number as u16,
            noise: (0..values)
                .map(|at| ((at + number) * 997 * number % 4001 - 2000) as i16)
                .collect(),
        })
        .collect()
}

fn tensors(format: &Format) -> Vec<ScaledTensor> {
    let mut state = 5u32;
    let mut next = move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        ((state >> 8) % 32_767) as i32 - 16_383
    };
    let tensors = format.tensors().iter().zip(format.limits());
    tensors
        .map(|(tensor, limits)| ScaledTensor {
            values: (0..tensor.len()).map(|_| next() as i16).collect(),
            bits: 15.clamp(limits.0, limits.1),
        })
        .collect()
}

/// Every weight that is not listed changes the loss, or makes a value too large for it. No weight that is listed does either.
#[test]
fn exactly_the_listed_weights_change_nothing() {
    let spec = EvalSpec::micro();
    let format = Format::new(&spec).unwrap();
    let listed: BTreeSet<(String, usize)> = format
        .unread()
        .iter()
        .flat_map(|stretch| {
            let tensor = &format.tensors()[stretch.tensor];
            (stretch.from..tensor.len()).map(|at| (tensor.name.clone(), at))
        })
        .collect();
    // Two of eight rows with 12 columns, and their biases.
    assert_eq!(listed.len(), 2 * 12 + 2);
    assert!(listed
        .iter()
        .all(|(name, _)| name.contains("action_out_proj")));

    let (sample, draws) = (sample(&spec), draws(&spec));
    let loss = |tensors: &[ScaledTensor]| {
        let weights: QuantisedWeights = format
            .assemble(|index| Ok::<_, WeightFileError>(tensors[index].clone()))
            .unwrap();
        let losses = draws
            .iter()
            .map(|draw| evaluate(&spec, &weights, &sample, draw, Overflow::Refused));
        losses.collect::<Result<Vec<_>, _>>().ok()
    };
    let tensors = tensors(&format);
    let before = loss(&tensors);
    assert!(before.is_some());
    let mut without_effect = BTreeSet::new();
    for index in 0..tensors.len() {
        for at in 0..tensors[index].values.len() {
            let changes = |other: i16| {
                let mut changed = tensors.clone();
                changed[index].values[at] = other;
                loss(&changed) != before
            };
            if !changes(-32_767) && !changes(32_767) {
                without_effect.insert((format.tensors()[index].name.clone(), at));
            }
        }
    }
    assert_eq!(without_effect, listed);
}

#[test]
fn where_every_action_dimension_is_real_every_weight_is_read() {
    let mut dims = EvalSpec::micro().dims;
    dims.action_dim = dims.max_action_dim;
    assert!(Format::new(&EvalSpec::new(dims))
        .unwrap()
        .unread()
        .is_empty());
}
