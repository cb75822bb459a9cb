//! What an argument costs the node's machine. It follows from the dimensions of the evaluation and the number of samples.

use crate::expert::argument::Shape;
use crate::expert::builder::{DATA, TABLES, WEIGHTS};
use crate::expert::evaluation::layers::Expert;
use crate::expert::statement::Statement;
use zk0_circuits::model::layout::Layout;
use zk0_circuits::model::linear::{bit_limits, linears};
use zk0_circuits::EvalSpec;

/// What an argument costs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cost {
    /// Seconds on two cores.
    pub seconds: f64,
    /// The most memory that is used at once, in bytes.
    pub memory: u64,
    /// The files of what is committed to, in bytes.
    pub files: u64,
}

// `cargo run --release -p zk0-argument --example full -- SIZE SAMPLES` prints what is expected beside what it took.

/// Bytes for each look-up of a sample: fractions, and the layers above them.
const BYTES_OF_A_LOOKUP: u64 = 50;
/// Bytes for each weight of both models, of which a node has the base in float32, too.
const BYTES_OF_A_WEIGHT: u64 = 4;
/// Bytes for each value of a table: its rows are counted.
const BYTES_OF_A_TABLE: u64 = 200;
/// Bytes for each value of each sample: what is left of it while the prover works on others. Trees of commitments are the largest part.
const BYTES_OF_A_SAMPLE: u64 = 8;
/// Bytes of a value in a file. Most have two, and some have eight.
const BYTES_IN_A_FILE: u64 = 4;
/// Look-ups that are proven in a second on two cores. `make prove-full` prints the seconds for four samples at the published size.
const LOOKUPS_PER_SECOND: f64 = 1.4e6;

/// Scales that any weights may have.
fn middle_scales(spec: &EvalSpec) -> [Vec<i16>; 2] {
    let tensors = Layout::new(&spec.dims).tensors.len();
    let limits = bit_limits(spec, tensors).into_iter();
    let scales: Vec<i16> = limits.map(|(least, most)| least.midpoint(most)).collect();
    [scales.clone(), scales]
}

/// Scales with which a statement has most look-ups. What is cut off has more limbs with more bits, and what exceeds the limits of a base's norm with fewer
/// bits of its gains.
pub(super) fn dearest_scales(spec: &EvalSpec) -> [Vec<i16>; 2] {
    let tensors = Layout::new(&spec.dims).tensors.len();
    let limits = bit_limits(spec, tensors).into_iter();
    let (mut base, update): (Vec<i16>, Vec<i16>) = limits.unzip();
    for output in linears(spec).iter().flat_map(|linear| &linear.outputs) {
        base[output.matrix] = update[output.matrix];
    }
    [base, update]
}

impl Cost {
    /// Of an argument about `samples` samples. It costs up to twice as much where the base `saturates` on any of them.
    pub fn of(spec: &EvalSpec, samples: u32, saturates: bool) -> Self {
        let expert = Expert::new(&Statement {
            saturates,
            ..Statement::of_weights(spec, middle_scales(spec))
        });
        let shape = Shape::new(&expert);
        let relations = &expert.builder.relations;
        let lookups = relations.lookups.iter();
        let lookups: u64 = lookups.map(|of| 1u64 << relations.size(&of.axes)).sum();
        let [data, weights, tables] =
            [DATA, WEIGHTS, TABLES].map(|source| expert.used[source.0 as usize] as u64);
        let columns: usize = shape.widths.iter().sum();
        let committed = (columns as u64) << shape.parameters.variables();
        let samples = u64::from(samples);
        Self {
            seconds: (samples * lookups) as f64 / LOOKUPS_PER_SECOND,
            memory: lookups * BYTES_OF_A_LOOKUP
                + weights * BYTES_OF_A_WEIGHT
                + tables * BYTES_OF_A_TABLE
                + samples * data * BYTES_OF_A_SAMPLE,
            files: samples * committed * BYTES_IN_A_FILE,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use zk0_circuits::model::spec::Dims;

    /// Measured at the published size: 435 s for four samples (`make prove-full`), and 8.6 GB for 16 (`make prove-full FULL_SAMPLES=16`), by a
    /// program that does not have the base in float32.
    #[test]
    fn memory_hardly_grows_with_samples_and_the_rest_grows_like_them() {
        let cost = |samples| Cost::of(&EvalSpec::new(Dims::FULL), samples, false);
        let (four, many) = (cost(4), cost(256));
        assert!((400.0..500.0).contains(&four.seconds), "{four:?}");
        let memory = 8_600_000_000..10_000_000_000;
        assert!(memory.contains(&cost(16).memory), "{four:?}");
        assert!(many.memory < 2 * four.memory, "{many:?}");
        assert_eq!(many.files, 64 * four.files);
        assert_eq!(many.seconds, 64.0 * four.seconds);
        let saturating = Cost::of(&EvalSpec::new(Dims::FULL), 4, true);
        assert!((1.5..2.0).contains(&(saturating.seconds / four.seconds)));
        assert!((1.5..2.0).contains(&(saturating.files as f64 / four.files as f64)));
    }

    fn lookups(spec: &EvalSpec, scales: [Vec<i16>; 2]) -> u64 {
        let statement = Statement {
            saturates: true,
            ..Statement::of_weights(spec, scales)
        };
        let relations = Expert::new(&statement).builder.relations;
        let sizes = relations.lookups.iter().map(|of| relations.size(&of.axes));
        sizes.map(|size| 1u64 << size).sum()
    }

    /// Gains and matrices have few, some or many bits, in both models.
    #[test]
    fn no_scales_are_dearer() {
        let spec = EvalSpec::micro();
        let most = lookups(&spec, dearest_scales(&spec));
        let [middle, _] = middle_scales(&spec);
        assert!(lookups(&spec, middle_scales(&spec)) < most);
        let limits = bit_limits(&spec, middle.len());
        let linears = linears(&spec);
        let outputs = linears.iter().flat_map(|linear| &linear.outputs);
        let matrices: Vec<usize> = outputs.map(|output| output.matrix).collect();
        let choice = |tensor: usize, which: usize| {
            let (few, many) = limits[tensor];
            [few, middle[tensor], many][which]
        };
        let models = (0..9).map(|which| {
            let of = |tensor| {
                if matrices.contains(&tensor) {
                    choice(tensor, which / 3)
                } else {
                    choice(tensor, which % 3)
                }
            };
            (0..middle.len()).map(of).collect::<Vec<i16>>()
        });
        let models: Vec<_> = models.collect();
        for base in &models {
            for update in &models {
                assert!(lookups(&spec, [base.clone(), update.clone()]) <= most);
            }
        }
    }
}
