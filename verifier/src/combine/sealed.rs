//! Verified weights outside memory, with a digest of each block to recognise their file.
//!
//! Between verification and the end of the round the file is on a disk, which can fail or be written to. If its bytes changed, a
//! wrong average would be signed. So verification takes the BLAKE3 digest of each block in memory. A combination reads a block
//! into its own memory, computes its digest, and sums those same bytes, so it uses only verified numbers, even if the file changes
//! meanwhile. That costs a third of
//! an average's time. The file's SHA-256 would cost more than the average, and could be compared only after the whole sum.

use crate::combine::error::CombineError;
use crate::combine::source::{Block, WeightSource};
use std::fmt::Display;
use zk0_circuits::{Digest, QuantisedWeights};
use zk0_weights::Format;

/// Weights' scales, and the digests of their blocks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sealed {
    scales: Vec<i16>,
    digests: Vec<Vec<[u8; 32]>>,
}

impl Sealed {
    /// Seals `weights` of this format.
    pub fn of(format: &Format, weights: &QuantisedWeights) -> Self {
        let seal = |index| {
            let (values, bits) = format.tensor(weights, index);
            let blocks = Block::of(index, values.len());
            let digests = blocks.map(|block| digest(&values[block.range()]));
            (bits, digests.collect())
        };
        let (scales, digests) = (0..format.tensors().len()).map(seal).unzip();
        Self { scales, digests }
    }
}

fn digest(values: &[i16]) -> [u8; 32] {
    blake3::hash(bytemuck::cast_slice(values)).into()
}

/// A file of sealed weights.
pub struct SealedFile<'a, F> {
    format: &'a Format,
    sealed: &'a Sealed,
    blob: Digest,
    read_at: &'a F,
}

impl<'a, F, E> SealedFile<'a, F>
where
    F: Fn(&Digest, u64, &mut [u8]) -> Result<(), E> + Sync,
    E: Display,
{
    /// The file `blob` of weights of this format. `read_at` fills a buffer with a file's bytes from a place on.
    pub fn new(format: &'a Format, sealed: &'a Sealed, blob: Digest, read_at: &'a F) -> Self {
        Self {
            format,
            sealed,
            blob,
            read_at,
        }
    }
}

impl<F, E> WeightSource for SealedFile<'_, F>
where
    F: Fn(&Digest, u64, &mut [u8]) -> Result<(), E> + Sync,
    E: Display,
{
    fn fits(&self, format: &Format) -> bool {
        self.format.spec() == format.spec()
    }

    fn bits(&self, tensor: usize) -> i16 {
        self.sealed.scales[tensor]
    }

    fn read<'b>(
        &'b self,
        block: &Block,
        buffer: &'b mut Vec<i16>,
    ) -> Result<&'b [i16], CombineError> {
        buffer.resize(block.len, 0);
        let (start, _) = self.format.place(block.tensor);
        let place = start + 2 * block.range().start as u64;
        // Files and memory are little-endian: zk0 runs on no other machines.
        (self.read_at)(&self.blob, place, bytemuck::cast_slice_mut(buffer)).map_err(|error| {
            CombineError::Unreadable {
                blob: self.blob,
                error: error.to_string(),
            }
        })?;
        if digest(buffer) == self.sealed.digests[block.tensor][block.number] {
            Ok(buffer)
        } else {
            Err(CombineError::Changed {
                blob: self.blob,
                tensor: self.format.tensors()[block.tensor].name.clone(),
            })
        }
    }
}
