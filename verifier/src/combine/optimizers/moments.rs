//! The moments of FedAdam as a file, read and written while a round's result is made.
//!
//! A safetensors file has the network's tensors, in order, each with a last dimension of 2 added: the first and the second moment
//! of each weight, in float32. So a weight takes 8 bytes.
//!
//! A combination follows the file's order. So only some tensors' moments are in memory, and both files' digests are computed on
//! the way. The numbers read count only if the whole file has the ledger's digest.

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

/// A weight's moments. Files and memory are little-endian: zk0 runs on no other machines.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Moment {
    /// The mean of the pseudo-gradients.
    pub first: f32,
    /// The mean of their squares.
    pub second: f32,
}

/// Fills a buffer with a file's bytes from a place on.
pub type ReadMoments<'a> = &'a dyn Fn(&Digest, u64, &mut [u8]) -> Result<(), String>;

/// The moments that the open round, or else the next one, goes on from.
pub fn needed(state: &State) -> Option<&ServerMoments> {
    state.moments().filter(|_| has_moments(state))
}

/// Whether the strategy in force has moments.
pub fn has_moments(state: &State) -> bool {
    matches!(state.rules().strategy, Strategy::FedAdam { .. })
}

/// The moments before and after a round.
pub struct Moments<'a> {
    before: Option<Before<'a>>,
    sink: &'a mut dyn Write,
    after: Sha256,
}

/// The file of the moments before.
struct Before<'a> {
    moments: ServerMoments,
    read_at: ReadMoments<'a>,
    place: u64,
    read: Sha256,
}

impl<'a> Moments<'a> {
    /// Moments that start as 0. The new ones are written to `sink`.
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

    /// The rounds behind them.
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

    /// Reads the next moments from before the round.
    pub(crate) fn read(&mut self, moments: &mut [Moment]) -> Result<(), CombineError> {
        match &mut self.before {
            Some(before) => before.fill(bytemuck::cast_slice_mut(moments)),
            None => {
                moments.fill(Moment::default());
                Ok(())
            }
        }
    }

    /// Writes the next new moments.
    pub(crate) fn write(&mut self, moments: &[Moment]) -> Result<(), CombineError> {
        self.keep(bytemuck::cast_slice(moments))
    }

    fn keep(&mut self, bytes: &[u8]) -> Result<(), CombineError> {
        let written = self.sink.write_all(bytes);
        written.map_err(|error| CombineError::MomentsUnwritten(error.to_string()))?;
        self.after.update(bytes);
        Ok(())
    }

    /// The digest of the new moments.
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

/// The start of every moments file of this format.
fn header(format: &Format) -> Vec<u8> {
    let tensors = format.tensors().iter().map(|tensor| {
        let shape = [&tensor.shape[..], &[2]].concat();
        (tensor.name.clone(), Dtype::F32, shape)
    });
    // Too few tensors to exceed the header limit.
    let header = TensorHeader::new(None, tensors)
        .to_bytes()
        .unwrap_or_default();
    [&(header.len() as u64).to_le_bytes()[..], &header].concat()
}
