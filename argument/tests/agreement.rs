//! The relations agree with the evaluation on random small models of all shapes.

use crate::models::Models;
use rayon::prelude::*;
use zk0_argument::expert::prover_values::{evaluate, Common, SampleValues, Unprovable};
use zk0_argument::prove::progress::silently;
use zk0_argument::prove::{check_equalities, Computed, Tables};
use zk0_circuits::model::spec::Dims;
use zk0_circuits::{Digest, EvalSpec};
use zk0_testkit::claims::Random;

/// Models that are tried.
const MODELS: u64 = 1000;

/// A random number from `least` to `most`.
fn between(random: &mut Random, least: u64, most: u64) -> u32 {
    (least + random.bits() % (most - least + 1)) as u32
}

/// Random dimensions: heads of any even width, layers of either kind, with and without room in each axis.
fn dims(random: &mut Random) -> Dims {
    let kv_heads = between(random, 1, 3);
    let max_action_dim = between(random, 1, 5);
    Dims {
        expert_width: 2 * between(random, 1, 6),
        expert_mlp: between(random, 1, 9),
        heads: kv_heads * between(random, 1, 3),
        kv_heads,
        head_dim: 2 * between(random, 1, 4),
        layers: between(random, 1, 4),
        self_attn_every: between(random, 1, 3),
        chunk: between(random, 1, 5),
        max_action_dim,
        action_dim: between(random, 1, max_action_dim as u64),
        max_prefix: between(random, 1, 7),
    }
}

/// Random scales around the default ones, which are 10.
fn scales(spec: &mut EvalSpec, random: &mut Random) {
    let mut vary =
        |bits: &mut u8, most: u8| *bits = (*bits + (random.bits() % 4) as u8).min(most) - 2;
    for layer in &mut spec.layers {
        for bits in [
            &mut layer.cache_key,
            &mut layer.cache_value,
            &mut layer.normed,
            &mut layer.query,
            &mut layer.attended,
            &mut layer.mlp_normed,
            &mut layer.up,
            &mut layer.gated,
            &mut layer.hidden,
        ] {
            vary(bits, 13);
        }
        vary(&mut layer.gate, 12);
        (layer.key, layer.value) = (layer.cache_key, layer.cache_value);
    }
    for bits in [
        &mut spec.action,
        &mut spec.embedding,
        &mut spec.time_activation,
        &mut spec.hidden,
        &mut spec.final_normed,
    ] {
        vary(bits, 12);
    }
    vary(&mut spec.time_hidden, 12);
}

/// Whether a model's evaluation gives a loss, and whether its base saturates. If it gives one, every relation holds on what follows from it.
fn agrees(seed: u64) -> Option<bool> {
    let mut random = Random(seed);
    let mut spec = EvalSpec::new(dims(&mut random));
    scales(&mut spec, &mut random);
    let samples = 1 + seed as usize % 3;
    let models = match seed % 4 {
        0 => Models::loud(&spec, samples, seed),
        _ => Models::new(&spec, samples, seed),
    };
    let weights = [&models.base, &models.update];
    let statement = match evaluate(Digest([7; 32]), &spec, weights, &models.samples, &silently) {
        Ok(evaluated) => evaluated,
        Err(Unprovable::Evaluation { .. }) => return None,
        Err(error) => panic!("seed {seed}: {error}"),
    };
    let common = Common::new(&statement, weights);
    for number in 0..models.samples.len() {
        let sample_values = SampleValues::of(&statement, &common, number, weights, &models.samples);
        let sample_values =
            sample_values.unwrap_or_else(|error| panic!("seed {seed}: {error} ({spec:?})"));
        let tables = Tables {
            relations: &sample_values.expert.builder.relations,
            sources: &sample_values.sources(&common),
            computed: &Computed::default(),
        };
        // The values were only made if every look-up found its row.
        if let Err(violation) = check_equalities(&tables) {
            panic!("seed {seed}: {violation} ({spec:?})");
        }
    }
    Some(statement.saturates)
}

#[test]
fn a_thousand_random_models_agree() {
    let agreed: Vec<bool> = (0..MODELS).into_par_iter().filter_map(agrees).collect();
    let saturated = agreed.iter().filter(|saturates| **saturates).count();
    let agreed = agreed.len();
    println!("{agreed} of {MODELS} agree, {saturated} of them with a base that saturates; the updates of the others overflow");
    assert!(agreed as u64 >= MODELS * 9 / 10);
    assert!(saturated as u64 >= MODELS / 5);
}
