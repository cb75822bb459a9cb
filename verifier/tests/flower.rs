//! Each strategy gives what Flower's own gives on the same numbers, but for the one rounding to int16.
//!
//! `scripts/compare-flower/run.sh` makes the results in `tests/fixtures/flower` anew. Flower 1.41 computed them in float64, from the
//! updates that lie beside them.

use crate::made;
use std::collections::BTreeSet;
use std::fs;
use std::io::sink;
use std::path::{Path, PathBuf};
use zk0_circuits::model::spec::Dims;
use zk0_circuits::{Digest, EvalSpec, NodeId, QuantisedWeights};
use zk0_protocol::rules::closing::server_moments::ServerMoments;
use zk0_protocol::rules::network_rules::Strategy;
use zk0_verifier::combine::bases::Bases;
use zk0_verifier::combine::contributions::WeightedContribution;
use zk0_verifier::combine::optimizers::moments::Moments;
use zk0_verifier::combine::source::WeightsInMemory;
use zk0_verifier::combine::strategy::combined;
use zk0_weights::{Format, Unread};

/// Updates, and how much each counts where a strategy averages by shares.
const SHARES: [u64; 7] = [10_000, 20_000, 5_000, 10_000, 3_333, 12_345, 10_000];

/// The strategies by the names of Flower's results. 2,900 basis points of 7 are 2, 6,000 are 4, and 2,000 are 1.
const CASES: [(&str, Strategy); 8] = [
    ("fed-avg", Strategy::FedAvg),
    ("median", Strategy::Median),
    ("trimmed-mean", Strategy::TrimmedMean { trim_bps: 2000 }),
    (
        "krum",
        Strategy::Krum {
            byzantine_bps: 2900,
        },
    ),
    (
        "multi-krum",
        Strategy::MultiKrum {
            byzantine_bps: 2900,
            keep_bps: 6000,
        },
    ),
    (
        "norm-clipping",
        Strategy::NormClipping { max_norm_bps: 9000 },
    ),
    (
        "fed-avg-m",
        Strategy::FedAvgM {
            server_rate_bps: 7000,
            momentum_bps: 9000,
        },
    ),
    (
        "fed-adam",
        Strategy::FedAdam {
            server_rate_billionths: 100_000_000,
            beta1_bps: 9000,
            beta2_bps: 9900,
            tau_billionths: 1_000_000,
        },
    ),
];

/// FedAdam's moments are rounded to float32 in each of two rounds. Together these errors are below 2^−20 of its rate, which is 0.1.
const MOMENTS_ERROR: f64 = 0.1 / (1u32 << 20) as f64;

/// Flower computes in float64. Its sums of 7 numbers of magnitudes up to 8, and the factor of norm clipping, are off by less.
const FLOAT_ERROR: f64 = 1e-13;

/// Norm clipping rounds its factor down to a multiple of 2^−32, so that each difference is shorter by up to that share of itself.
/// No value differs from the base's by more than 16.
const CLIPPING_ERROR: f64 = 16.0 / (1u64 << 32) as f64;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/fixtures/flower")
}

/// The smallest expert that has all kinds of tensors. All of its action dimensions are real, so that it has no unread weights.
fn spec() -> EvalSpec {
    EvalSpec::new(Dims {
        expert_width: 6,
        expert_mlp: 8,
        heads: 2,
        kv_heads: 1,
        head_dim: 4,
        layers: 2,
        self_attn_every: 2,
        chunk: 3,
        max_action_dim: 4,
        action_dim: 4,
        max_prefix: 4,
    })
}

/// Weights at a distance from those of seed 0, with some tensors so large that their scales differ.
fn weights(spec: &EvalSpec, seed: u32, distance: f32, growth: f32) -> QuantisedWeights {
    let (middle, own) = (
        made::tensors(spec, 0, 1.0),
        made::tensors(spec, seed + 1, 1.0),
    );
    let tensors = middle.into_iter().enumerate();
    let tensors = tensors.map(|(index, (name, values))| {
        let growth = if index % 3 == 0 { growth } else { 1.0 };
        let pairs = values.iter().zip(&own[&name]);
        let values = pairs.map(|(middle, own)| growth * (middle + distance * own));
        (name, values.collect())
    });
    made::quantise(spec, &tensors.collect())
}

/// The files that Flower's results are of, by name.
fn inputs() -> Vec<(String, Vec<u8>)> {
    let (spec, format) = (spec(), made::format(&spec()));
    // The last two are far from the others.
    let distances = [0.1, 0.15, 0.2, 0.25, 0.3, 3.0, 4.0];
    let growths = [1.0, 1.0, 2.1, 1.0, 1.3, 1.0, 4.2];
    let updates = (0..).zip(distances.into_iter().zip(growths));
    let updates = updates.map(|(number, (distance, growth))| {
        let weights = weights(&spec, number, distance, growth);
        (format!("update-{number}.safetensors"), weights)
    });
    let bases = [("base", 20, 0.3), ("earlier", 21, 0.5)];
    let bases = bases.map(|(name, seed, distance)| {
        let weights = weights(&spec, seed, distance, 1.0);
        (format!("{name}.safetensors"), weights)
    });
    let all = updates.chain(bases);
    all.map(|(name, weights)| (name, format.write(&weights)))
        .collect()
}

#[test]
fn the_files_that_flower_read_are_these() {
    for (name, file) in inputs() {
        let path = folder().join(name);
        if std::env::var_os("ZK0_WRITE_FLOWER").is_some() {
            fs::create_dir_all(folder()).unwrap();
            fs::write(&path, &file).unwrap();
        }
        assert!(fs::read(&path).unwrap() == file, "{}", path.display());
    }
}

fn read(format: &Format, name: &str) -> QuantisedWeights {
    let file = fs::read(folder().join(format!("{name}.safetensors"))).unwrap();
    format.read(&file).unwrap()
}

/// The moments after a round that went from `earlier`, and whose one update was `base`.
fn first_moments(format: &Format, strategy: Strategy, bases: &Bases, kept: &mut Vec<u8>) -> Digest {
    let weights = WeightsInMemory {
        format,
        weights: bases.base.as_ref().unwrap(),
    };
    let update = WeightedContribution {
        node: NodeId([1; 32]),
        weight: 1,
        weights: &weights,
    };
    let start = Bases {
        base: bases.earlier.clone(),
        earlier: None,
    };
    let file = format.write(start.base.as_ref().unwrap());
    let unread = Unread::of(format, &format.open(&file[..]).unwrap()).unwrap();
    let mut moments = Moments::afresh(kept);
    let result = combined(format, &[update], strategy, &start, &unread, &mut moments);
    result.unwrap().moments.unwrap()
}

#[test]
fn each_strategy_gives_what_flower_s_own_gives() {
    let format = made::format(&spec());
    let updates: Vec<_> = (0..SHARES.len())
        .map(|number| read(&format, &format!("update-{number}")))
        .collect();
    let updates = updates.iter().map(|weights| WeightsInMemory {
        format: &format,
        weights,
    });
    let updates: Vec<_> = updates.collect();
    let given = (1..).zip(SHARES).zip(&updates);
    let given = given.map(|((node, weight), weights)| WeightedContribution {
        node: NodeId([node; 32]),
        weight,
        weights,
    });
    let given: Vec<_> = given.collect();
    let base = read(&format, "base");
    let base_file = format.write(&base);
    let unread = Unread::of(&format, &format.open(&base_file[..]).unwrap()).unwrap();
    let bases = Bases {
        base: Some(base),
        earlier: Some(read(&format, "earlier")),
    };
    // FedAdam is in its second round. Its first one went from `earlier`, and its one update was `base`.
    let [.., (_, fed_adam)] = CASES;
    let mut first = Vec::new();
    let before = ServerMoments {
        blob: first_moments(&format, fed_adam, &bases, &mut first),
        steps: 1,
    };
    let read_moments = |_: &Digest, place, buffer: &mut [u8]| {
        buffer.copy_from_slice(&first[place as usize..][..buffer.len()]);
        Ok(())
    };
    let mut files = BTreeSet::new();
    for (name, strategy) in CASES {
        let mut nowhere = sink();
        let mut moments = Moments::from(before, &read_moments, &mut nowhere);
        let file = combined(&format, &given, strategy, &bases, &unread, &mut moments);
        let file = file.unwrap().file;
        let result = format.read(file.bytes()).unwrap();
        let flower = fs::read(folder().join(format!("{name}.safetensors"))).unwrap();
        let flower = safetensors::SafeTensors::deserialize(&flower).unwrap();
        let (mut scales, mut furthest) = (Vec::new(), 0f64);
        for (index, tensor) in format.tensors().iter().enumerate() {
            let (values, bits) = format.tensor(&result, index);
            let step = 1.0 / f64::from(1u32 << bits);
            scales.push(bits);
            let theirs = flower.tensor(&tensor.name).unwrap();
            assert_eq!(theirs.shape(), tensor.shape);
            let theirs = theirs.data().as_chunks::<8>().0;
            for (value, theirs) in values.iter().zip(theirs) {
                let off = (f64::from(*value) * step - f64::from_le_bytes(*theirs)).abs();
                let own_error = match strategy {
                    Strategy::NormClipping { .. } => CLIPPING_ERROR,
                    Strategy::FedAdam { .. } => MOMENTS_ERROR,
                    _ => 0.0,
                };
                // Half a unit of the last place of the result's scale, and the errors that are named above.
                assert!(
                    off <= step / 2.0 + FLOAT_ERROR + own_error,
                    "{name}, {}: {off} at a step of {step}",
                    tensor.name
                );
                furthest = furthest.max(off / step);
            }
        }
        scales.sort_unstable();
        scales.dedup();
        assert!(scales.len() > 2, "{name}: {scales:?}");
        println!("{name}: at most {furthest} of a step off");
        // Krum takes one of the given updates as it is.
        assert_eq!(furthest == 0.0, name == "krum", "{name}");
        assert!(
            files.insert(file.into_bytes()),
            "{name} gives what another strategy gives"
        );
    }
}
