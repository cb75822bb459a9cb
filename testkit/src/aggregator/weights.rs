//! Expert weights as files.

use zk0_circuits::{EvalSpec, Mode, WeightsDigest};
use zk0_verifier::Evaluation;
use zk0_weights::scale::narrowed;
use zk0_weights::{Format, WeightFileError};

/// Weights that differ with `seed`.
pub fn weights(seed: u32) -> Vec<u8> {
    let format = Format::new(&EvalSpec::micro()).unwrap();
    let weights = format.assemble(|tensor| {
        let value = |at: usize| {
            let mixed = (at as u32 * 2_654_435_761) ^ (tensor as u32 * 40_503) ^ (seed * 97_003);
            // At most about 0.1, in units of 2^−24.
            i128::from(mixed % 2001) * 1678 - 1_678_000
        };
        let values: Vec<_> = (0..format.tensors()[tensor].len()).map(value).collect();
        Ok::<_, WeightFileError>(narrowed(&values, 1, format.limits()[tensor]))
    });
    format.write(&weights.unwrap())
}

/// A file's digests.
pub fn digest(file: &[u8]) -> WeightsDigest {
    let evaluation = Evaluation::new(&EvalSpec::micro(), Mode::Direct).unwrap();
    evaluation.digest(file, &evaluation.read(file).unwrap())
}
