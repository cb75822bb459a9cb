//! The moments of FedAdam as a file, read and written while a round's result is made.
//!
//! The file is a safetensors file with the tensors of the network's weights, in their order. Each has the shape of the weight's tensor and
//! a last dimension of 2: the first and the second moment of each weight, in float32. So a file has 8 bytes for each weight.
//!
//! A combination goes through the weights in the order of the file. Hence the moments of some tensors at a time are in memory, and the
//! digests of both files are computed on the way. What was read counts only if all of it has the digest that the ledger names.

use crate::combine::error::CombineError;
use bytemuck::{Pod, Zeroable};
use sha2::{Digest as _, Sha256};
use std::io::Write;
use zk0_circuits::Digest;
use zk0_protocol::rules::closing::server_moments::ServerMoments;
use zk0_protocol::rules::network_rules::Strategy;
use zk0_protocol::rules::state::State;
use zk0_tensors::{Dtype, TensorHeader};
use zk0_weights::Format;

/// The moments of a weight. Files and memory are both little-endian: zk0 runs on little-endian machines only.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Moment {
    /// The mean of the weight's pseudo-gradients.
    pub first: f32,
    /// The mean of their squares.
    pub second: f32,
}

/// Fills a buffer with the bytes of a file from a place on, or says why it cannot.
pub type ReadMoments<'a> = &'a dyn Fn(&Digest, u64, &mut [u8]) -> Result<(), String>;

/// Whether the open round, or else the next one, goes on from moments, and from which.
pub fn needed(state: &State) -> Option<&ServerMoments> {
    state.moments().filter(|_| has_moments(state))
}

/// Whether the strategy in force has moments.
pub fn has_moments(state: &State) -> bool {
    matches!(state.rules().strategy, Strategy::FedAdam { .. })
}

/// The moments that a round starts with, and those that it ends with.
pub struct Moments<'a> {
    before: Option<Before<'a>>,
    sink: &'a mut dyn Write,
    after: Sha256,
}

/// The file of the moments that a round starts with.
struct Before<'a> {
    moments: ServerMoments,
    read_at: ReadMoments<'a>,
    place: u64,
    read: Sha256,
}

impl<'a> Moments<'a> {
    /// Moments that begin afresh: all of them are 0. Those that the round ends with are written to `sink`.
    pub fn afresh(sink: &'a mut dyn Write) -> Self {
        Self {
            before: None,
            sink,
            after: Sha256::new(),
        }
    }

    /// Goes on from `moments`, whose file `read_at` reads.
    pub fn from(moments: ServerMoments, read_at: ReadMoments<'a>, sink: &'a mut dyn Write) -> Self {
        let before = Before {
            moments,
            read_at,
            place: 0,
            read: Sha256::new(),
        };
        Self {
            before: Some(before),
            ..Self::afresh(sink)
        }
    }

    /// From how many rounds they follow.
    pub fn steps(&self) -> u64 {
        ServerMoments::steps(self.before.as_ref().map(|before| &before.moments))
    }

    /// Begins both files.
    pub(crate) fn begin(&mut self, format: &Format) -> Result<(), CombineError> {
        let header = header(format);
        if let Some(before) = &mut self.before {
            before.fill(&mut header.clone())?;
        }
        self.keep(&header)
    }

    /// The next moments that the round starts with.
    pub(crate) fn read(&mut self, moments: &mut [Moment]) -> Result<(), CombineError> {
        match &mut self.before {
            Some(before) => before.fill(bytemuck::cast_slice_mut(moments)),
            None => {
                moments.fill(Moment::default());
                Ok(())
            }
        }
    }

    /// The next moments that the round ends with.
    pub(crate) fn write(&mut self, moments: &[Moment]) -> Result<(), CombineError> {
        self.keep(bytemuck::cast_slice(moments))
    }

    fn keep(&mut self, bytes: &[u8]) -> Result<(), CombineError> {
        let written = self.sink.write_all(bytes);
        written.map_err(|error| CombineError::MomentsUnwritten(error.to_string()))?;
        self.after.update(bytes);
        Ok(())
    }

    /// The digest of the moments that the round ends with.
    pub(crate) fn finish(&mut self) -> Result<Digest, CombineError> {
        if let Some(before) = &self.before {
            let expected = before.moments.blob;
            let actual = Digest(before.read.clone().finalize().into());
            if actual != expected {
                return Err(CombineError::OtherMoments { expected, actual });
            }
        }
        Ok(Digest(self.after.clone().finalize().into()))
    }
}

impl Before<'_> {
    fn fill(&mut self, bytes: &mut [u8]) -> Result<(), CombineError> {
        let blob = self.moments.blob;
        (self.read_at)(&blob, self.place, bytes)
            .map_err(|error| CombineError::MomentsUnreadable { blob, error })?;
        self.read.update(&*bytes);
        self.place += bytes.len() as u64;
        Ok(())
    }
}

/// The beginning of each file of moments of this format, up to the numbers.
fn header(format: &Format) -> Vec<u8> {
    let tensors = format.tensors().iter().map(|tensor| {
        let shape = [&tensor.shape[..], &[2]].concat();
        (tensor.name.clone(), Dtype::F32, shape)
    });
    // A network has too few tensors for a header beyond the format's limit.
    let header = TensorHeader::new(None, tensors)
        .to_bytes()
        .unwrap_or_default();
    [&(header.len() as u64).to_le_bytes()[..], &header].concat()
}
