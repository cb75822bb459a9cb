//! Where a combination reads weights, a block at a time.

use crate::combine::error::CombineError;
use std::ops::Range;
use zk0_circuits::QuantisedWeights;
use zk0_weights::Format;

/// Values in a block: 128 KiB, which stay in a core's cache during the sum.
pub const BLOCK: usize = 1 << 16;

/// A block of a tensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Block {
    /// The tensor's number.
    pub tensor: usize,
    /// The block's number in the tensor, from 0.
    pub number: usize,
    /// Its number of values.
    pub len: usize,
}

impl Block {
    /// The blocks of a tensor with `len` values.
    pub fn of(tensor: usize, len: usize) -> impl Iterator<Item = Self> {
        (0..len.div_ceil(BLOCK)).map(move |number| Self {
            tensor,
            number,
            len: BLOCK.min(len - number * BLOCK),
        })
    }

    /// All blocks of a network's weights.
    pub fn all(format: &Format) -> Vec<Self> {
        let tensors = format.tensors().iter().enumerate();
        let blocks = tensors.flat_map(|(index, tensor)| Self::of(index, tensor.len()));
        blocks.collect()
    }

    /// Its range among the tensor's values.
    pub fn range(&self) -> Range<usize> {
        let from = self.number * BLOCK;
        from..from + self.len
    }
}

/// Weights that several threads read by block.
pub trait WeightSource: Sync {
    /// Whether the weights have this format.
    fn fits(&self, format: &Format) -> bool;

    /// The fraction bits of tensor number `tensor`.
    fn bits(&self, tensor: usize) -> i16;

    /// The values of `block`, read into `buffer` unless they are in memory.
    ///
    /// # Errors
    /// They cannot be read, or are not the verified ones.
    fn read<'b>(
        &'b self,
        block: &Block,
        buffer: &'b mut Vec<i16>,
    ) -> Result<&'b [i16], CombineError>;
}

/// Weights in memory.
#[derive(Clone, Copy, Debug)]
pub struct WeightsInMemory<'a> {
    /// Their format.
    pub format: &'a Format,
    /// The weights.
    pub weights: &'a QuantisedWeights,
}

impl WeightSource for WeightsInMemory<'_> {
    fn fits(&self, format: &Format) -> bool {
        format.fits(self.weights)
    }

    fn bits(&self, tensor: usize) -> i16 {
        self.format.tensor(self.weights, tensor).1
    }

    fn read<'b>(&'b self, block: &Block, _: &'b mut Vec<i16>) -> Result<&'b [i16], CombineError> {
        let (tensor, _) = self.format.tensor(self.weights, block.tensor);
        Ok(&tensor[block.range()])
    }
}

/// A thread's memory for blocks.
#[derive(Debug, Default)]
pub struct BlockBuffer {
    buffers: Vec<Vec<i16>>,
}

impl BlockBuffer {
    /// Reads `block` of each source.
    ///
    /// # Errors
    /// One cannot be read.
    pub fn read<'b>(
        &'b mut self,
        weights: &'b [&dyn WeightSource],
        block: &Block,
    ) -> Result<Vec<&'b [i16]>, CombineError> {
        self.buffers.resize_with(weights.len(), Vec::new);
        let pairs = weights.iter().zip(&mut self.buffers);
        pairs
            .map(|(weights, buffer)| weights.read(block, buffer))
            .collect()
    }
}
