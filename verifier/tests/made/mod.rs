//! Weights, a sample and a claim that tests make themselves.

use std::collections::BTreeMap;
use std::io::sink;
use std::path::Path;
use std::{env, fs};
use zk0_circuits::claim::student::Confidence;
use zk0_circuits::claim::t_test::TTest;
use zk0_circuits::model::draw::Draw;
use zk0_circuits::model::layout::expert_tensors;
use zk0_circuits::model::sample::SampleParts;
use zk0_circuits::{
    DatasetCommitment, Digest, EvalSpec, Mode, NodeId, QuantisedWeights, Sample, Terms,
    WeightsDigest,
};
use zk0_protocol::rules::network_rules::Strategy;
use zk0_verifier::combine::bases::Bases;
use zk0_verifier::combine::blocks::{Combination, Plan};
use zk0_verifier::combine::contributions::WeightedContribution;
use zk0_verifier::combine::error::CombineError;
use zk0_verifier::combine::optimizers::moments::Moments;
use zk0_verifier::combine::source::{Block, BlockBuffer, WeightSource};
use zk0_verifier::combine::strategy::combined;
use zk0_verifier::Evaluation;
use zk0_weights::rounding::Unit;
use zk0_weights::{BuiltFile, Format, ScaledTensor, Unread};

/// Float32 weights by name.
pub type Tensors = BTreeMap<String, Vec<f32>>;

/// The rows of `action_out_proj` that the evaluation does not read begin here, in the weight and in the bias.
pub const UNREAD: [(&str, usize); 2] = [
    ("model.action_out_proj.weight", 6 * 12),
    ("model.action_out_proj.bias", 6),
];

/// Makes small weights that differ with `seed`. The velocity's weights are scaled by `loud`.
pub fn tensors(spec: &EvalSpec, seed: u32, loud: f32) -> Tensors {
    let mut state = seed;
    let mut next = move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 23) as f32 - 1.0
    };
    expert_tensors(&spec.dims)
        .into_iter()
        .map(|tensor| {
            let scale = if tensor.name.contains("action_out") {
                0.4 * loud
            } else {
                0.4
            };
            let values = (0..tensor.len()).map(|_| scale * next()).collect();
            (tensor.name, values)
        })
        .collect()
}

/// `update`, with the weights of `base` where the evaluation does not read.
pub fn unread_of(base: &Tensors, mut update: Tensors) -> Tensors {
    for (name, from) in UNREAD {
        update.get_mut(name).unwrap()[from..].copy_from_slice(&base[name][from..]);
    }
    update
}

pub fn quantise(spec: &EvalSpec, tensors: &Tensors) -> QuantisedWeights {
    QuantisedWeights::quantise(spec, |name| tensors.get(name).map(Vec::as_slice)).unwrap()
}

/// The numbers that these weights have as int16: what a node reads of a base.
pub fn rounded(spec: &EvalSpec, tensors: &Tensors) -> Tensors {
    let (format, weights) = (format(spec), quantise(spec, tensors));
    let tensors = format.tensors().iter().enumerate();
    let tensors = tensors.map(|(index, tensor)| {
        let (values, bits) = format.tensor(&weights, index);
        let unit = (1u32 << bits) as f32;
        let values = values.iter().map(|value| f32::from(*value) / unit);
        (tensor.name.clone(), values.collect())
    });
    tensors.collect()
}

pub fn format(spec: &EvalSpec) -> Format {
    Format::new(spec).unwrap()
}

pub fn file(spec: &EvalSpec, tensors: &Tensors) -> Vec<u8> {
    format(spec).write(&quantise(spec, tensors))
}

pub fn sample(spec: &EvalSpec) -> Sample {
    let dims = &spec.dims;
    let cache = vec![0.25; 3 * dims.kv_width()];
    let cache: Vec<_> = (0..dims.layers).map(|_| (&cache[..], &cache[..])).collect();
    let actions = vec![0.0; (dims.chunk * dims.max_action_dim) as usize];
    let is_pad = vec![false; dims.chunk as usize];
    let parts = SampleParts {
        cache: &cache,
        actions: &actions,
        is_pad: &is_pad,
    };
    Sample::quantise(spec, parts).unwrap()
}

/// Some noise and a flow time.
pub fn draw(spec: &EvalSpec) -> Draw {
    let values = (spec.dims.chunk * spec.dims.max_action_dim) as i32;
    Draw {
        time: 1 << 15,
        noise: (0..values)
            .map(|at| (at * 997 % 4001 - 2000) as i16)
            .collect(),
    }
}

/// The terms of a claim about two files of weights and one sample.
pub fn terms(
    spec: &EvalSpec,
    mode: Mode,
    dataset: DatasetCommitment,
    base: &[u8],
    update: &[u8],
) -> Terms {
    let evaluation = Evaluation::new(spec, mode).unwrap();
    let digest =
        |file: &[u8]| -> WeightsDigest { evaluation.digest(file, &evaluation.read(file).unwrap()) };
    Terms {
        network: Digest([1; 32]),
        round: 0,
        node: NodeId([2; 32]),
        dataset,
        evaluation: spec.digest(),
        base: digest(base),
        update: digest(update),
        challenge: Digest([6; 32]),
        eval_samples: 1,
        test: TTest {
            min_improvement_bps: 1,
            confidence: Confidence::P95,
        },
    }
}

/// Each strategy; the last three read base weights, and the last one has moments.
pub const STRATEGIES: [Strategy; 8] = [
    Strategy::FedAvg,
    Strategy::Median,
    Strategy::TrimmedMean { trim_bps: 2500 },
    Strategy::Krum {
        byzantine_bps: 2000,
    },
    Strategy::MultiKrum {
        byzantine_bps: 2000,
        keep_bps: 6000,
    },
    Strategy::NormClipping { max_norm_bps: 9000 },
    Strategy::FedAvgM {
        server_rate_bps: 7000,
        momentum_bps: 9000,
    },
    FED_ADAM,
];

/// FedAdam with steps as large as the weights that tests make.
pub const FED_ADAM: Strategy = Strategy::FedAdam {
    server_rate_billionths: 300_000_000,
    beta1_bps: 9000,
    beta2_bps: 9900,
    tau_billionths: 1_000_000,
};

/// Combines weights where moments begin afresh and nobody keeps them.
pub fn combine(
    format: &Format,
    given: &[WeightedContribution<'_>],
    strategy: Strategy,
    bases: &Bases,
    unread: &Unread,
) -> Result<BuiltFile, CombineError> {
    let mut nowhere = sink();
    let moments = &mut Moments::afresh(&mut nowhere);
    combined(format, given, strategy, bases, unread, moments).map(|combined| combined.file)
}

/// Weights of one tensor with one block.
pub struct OneTensor(pub ScaledTensor);

impl WeightSource for OneTensor {
    fn fits(&self, _: &Format) -> bool {
        true
    }

    fn bits(&self, _: usize) -> i16 {
        self.0.bits
    }

    fn read<'b>(&'b self, _: &Block, _: &'b mut Vec<i16>) -> Result<&'b [i16], CombineError> {
        Ok(&self.0.values)
    }
}

/// The numbers of the one block of the one tensor, of `len` values.
pub fn exact_numbers(combination: &impl Combination, len: usize) -> (Plan, Vec<i128>) {
    let block = Block {
        tensor: 0,
        number: 0,
        len,
    };
    let mut numbers = vec![0; len];
    let mut rows = BlockBuffer::default();
    combination
        .combine(&block, &mut numbers, &mut [], &mut rows)
        .unwrap();
    (combination.plan(0), numbers)
}

/// Exact numbers, rounded within these limits.
pub fn rounded_to(numbers: &[i128], unit: Unit, limits: (i16, i16)) -> ScaledTensor {
    let largest = numbers.iter().map(|one| one.unsigned_abs()).max().unwrap();
    let bits = unit.scale(largest, limits);
    let mut bytes = vec![0; 2 * numbers.len()];
    unit.to(bits).write(numbers, largest, &mut bytes);
    let pairs = bytes.chunks_exact(2);
    ScaledTensor {
        values: pairs
            .map(|pair| i16::from_le_bytes([pair[0], pair[1]]))
            .collect(),
        bits,
    }
}

/// Compares digests with those committed in `vectors/`. `ZK0_WRITE_VECTORS=1` writes them.
#[track_caller]
pub fn check_vector(name: &str, digests: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/vectors/{name}.sha256"));
    if env::var_os("ZK0_WRITE_VECTORS").is_some() {
        fs::write(&path, digests).unwrap();
    }
    assert_eq!(digests, fs::read_to_string(&path).unwrap());
}
