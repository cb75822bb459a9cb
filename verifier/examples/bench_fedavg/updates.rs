//! Updates that are made up, and their average.

use rayon::prelude::*;
use std::fs::{self, File};
use std::io::sink;
use std::path::{Path, PathBuf};
use zk0_circuits::{Digest, NodeId};
use zk0_protocol::rules::network_rules::Strategy;
use zk0_verifier::combine::bases::Bases;
use zk0_verifier::combine::blocks::{Combination, Integer};
use zk0_verifier::combine::contributions::WeightedContribution;
use zk0_verifier::combine::fedavg::average;
use zk0_verifier::combine::optimizers::moments::Moments;
use zk0_verifier::combine::source::{Block, BlockBuffer, WeightSource};
use zk0_verifier::combine::strategy::combined;
use zk0_verifier::{blob_digest, Evaluation};
use zk0_weights::{BuiltFile, Format, ScaledTensor, Unread, WeightFileError};

/// Writes `updates` files of random weights. A tensor has one of two scales, another one in every second update.
pub fn make(evaluation: &Evaluation, updates: usize, folder: &Path) {
    let format = evaluation.format();
    for update in 0..updates {
        let mut state = update as u64 + 1;
        let weights = format.assemble(|index| {
            let values = (0..format.tensors()[index].len()).map(|_| {
                state = state
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1_442_695_040_888_963_407);
                ((state >> 48) as i16).max(-i16::MAX)
            });
            let (least, most) = format.limits()[index];
            Ok::<_, WeightFileError>(ScaledTensor {
                values: values.collect(),
                bits: (most - ((index + update) % 2) as i16).max(least),
            })
        });
        let file = format.write(&weights.expect("weights"));
        fs::write(folder.join(format!("update-{update:03}.safetensors")), file).expect("writing");
    }
}

/// The files of the updates in a folder, with digests that tell them apart.
pub fn files(folder: &Path) -> Vec<(PathBuf, Digest)> {
    let entries = fs::read_dir(folder).expect("the folder can be read");
    let paths = entries.map(|entry| entry.expect("the folder can be read").path());
    let is_update = |path: &PathBuf| path.to_string_lossy().contains("update-");
    let mut paths: Vec<_> = paths.filter(is_update).collect();
    paths.sort();
    let named = |path: PathBuf| {
        let name = blob_digest(path.to_string_lossy().as_bytes());
        (path, name)
    };
    paths.into_iter().map(named).collect()
}

/// FedAvg with equal shares.
pub struct Average<'a> {
    format: &'a Format,
    given: Vec<WeightedContribution<'a>>,
    unread: Unread,
}

impl<'a> Average<'a> {
    /// The average of `updates` in a round that started from the weights in the file `base`.
    pub fn of(
        format: &'a Format,
        base: &Path,
        updates: impl Iterator<Item = &'a dyn WeightSource>,
    ) -> Self {
        let base = File::open(base).expect("the file can be opened");
        let base = format.open(base).expect("weights");
        let given = (0u64..).zip(updates).map(|(number, weights)| {
            let mut node = [0; 32];
            node[..8].copy_from_slice(&number.to_be_bytes());
            WeightedContribution {
                node: NodeId(node),
                weight: 10_000,
                weights,
            }
        });
        Self {
            format,
            given: given.collect(),
            unread: Unread::of(format, &base).expect("weights"),
        }
    }

    /// All exact sums, by all cores, a block after the other in the same memory. Gives the largest.
    pub fn sums(&self) -> u128 {
        let average = average(&self.given).expect("an average");
        let blocks = Block::all(self.format);
        let largest = blocks.par_iter().map_init(
            || (BlockBuffer::default(), Vec::new()),
            |(rows, numbers), block| {
                numbers.clear();
                numbers.resize(block.len, 0i32);
                average
                    .combine(block, numbers, &mut [], rows)
                    .expect("they are in memory");
                i32::largest(numbers)
            },
        );
        largest.max().unwrap_or(0)
    }

    /// The file of the result.
    pub fn file(&self) -> BuiltFile {
        let mut nowhere = sink();
        let result = combined(
            self.format,
            &self.given,
            Strategy::FedAvg,
            &Bases::default(),
            &self.unread,
            &mut Moments::afresh(&mut nowhere),
        );
        result.expect("an average").file
    }
}
