//! The private input of a proof, and its encoding as flat byte buffers, which the guest reads cheaply.

use crate::claim::dataset::leaf;
use crate::claim::losses::Disclosure;
use crate::claim::terms::Terms;
use crate::model::sample::{Sample, SampleError};
use crate::model::spec::{EvalSpec, SpecError};
use crate::model::weights::{QuantisedWeights, WeightsError};
use crate::vm::digest::Digest;
use alloc::vec::Vec;
use borsh::{BorshDeserialize, BorshSerialize};

/// The small part of a private input: the specification, the terms, and the dataset's secret salt.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Header {
    /// Evaluation specification of the round; `terms.evaluation` is its digest.
    pub spec: EvalSpec,
    /// The terms of the claim.
    pub terms: Terms,
    /// What the claim discloses of the losses.
    pub disclosure: Disclosure,
    /// Secret salt of the dataset.
    pub salt: [u8; 32],
}

/// An evaluated sample and the proof that it is in the dataset.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Opening {
    /// Index in the dataset.
    pub index: u64,
    /// The sample.
    pub sample: Sample,
    /// RFC 6962 inclusion path of its leaf.
    pub path: Vec<Digest>,
}

impl Opening {
    /// Leaf of the sample in the dataset.
    pub fn leaf(&self, header: &Header) -> Digest {
        leaf(&header.salt, &self.sample.digest())
    }
}

/// What [`crate::claim::statement::check`] needs, in mode `direct`. It holds the samples and the salt, which nobody but the node
/// may see.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PrivateInput {
    /// Specification, terms, salt.
    pub header: Header,
    /// Weights the round started from.
    pub base: QuantisedWeights,
    /// Weights contributed.
    pub update: QuantisedWeights,
    /// In the order the challenge draws them.
    pub openings: Vec<Opening>,
}

/// Number of buffers of an encoded private input.
pub const INPUT_BUFFERS: usize = 4;

/// Why buffers do not hold a private input.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum InputError {
    /// Wrong number of buffers.
    #[error("this private input takes {expected} buffers, but there are {found}")]
    Buffers {
        /// Buffers there.
        found: usize,
        /// Buffers needed.
        expected: usize,
    },
    /// The first buffer does not hold a header, with an index and a path for each opening.
    #[error("the first buffer does not hold the header of a private input")]
    Header,
    /// The specification is not valid.
    #[error(transparent)]
    Spec(#[from] SpecError),
    /// Base or update weights.
    #[error("{which} weights: {error}")]
    Weights {
        /// `base` or `update`.
        which: &'static str,
        /// Why.
        error: WeightsError,
    },
    /// A sample.
    #[error("sample of opening {position}: {error}")]
    Sample {
        /// Which opening.
        position: usize,
        /// Why.
        error: SampleError,
    },
    /// Bytes after the last value.
    #[error("{0} bytes are left after the last sample or word")]
    TrailingBytes(usize),
}

impl PrivateInput {
    /// Encodes the private input as four buffers: header, indices and paths (borsh); base weights; update weights; samples
    /// one after another (each raw little-endian int16, padded to 8 bytes).
    pub fn to_buffers(&self) -> [Vec<u8>; INPUT_BUFFERS] {
        [
            head(&self.header, &self.openings),
            self.base.as_bytes().to_vec(),
            self.update.as_bytes().to_vec(),
            samples(&self.openings),
        ]
    }

    /// Reads what [`Self::to_buffers`] wrote. It trusts no length in the buffers, and it validates the specification first,
    /// so that it allocates nothing larger than the buffers.
    pub fn from_buffers<B: AsRef<[u8]>>(buffers: &[B]) -> Result<Self, InputError> {
        let [head, base, update, samples] = buffers else {
            return Err(InputError::Buffers {
                found: buffers.len(),
                expected: INPUT_BUFFERS,
            });
        };
        let (header, places) = read_head(head.as_ref())?;
        let weights = |which, bytes: &B| {
            QuantisedWeights::from_bytes(&header.spec, bytes.as_ref())
                .map_err(|error| InputError::Weights { which, error })
        };
        Ok(Self {
            base: weights("base", base)?,
            update: weights("update", update)?,
            openings: read_samples(&header.spec, places, samples.as_ref())?,
            header,
        })
    }
}

/// Index and path of an opening.
type OpeningPlace = (u64, Vec<Digest>);

/// Encodes the header, and for each opening its index and path.
fn head(header: &Header, openings: &[Opening]) -> Vec<u8> {
    let places: Vec<(u64, &Vec<Digest>)> = openings
        .iter()
        .map(|opening| (opening.index, &opening.path))
        .collect();
    // Writing to memory does not fail.
    borsh::to_vec(&(header, places)).unwrap_or_default()
}

/// Reads [`head`] and validates the specification.
fn read_head(bytes: &[u8]) -> Result<(Header, Vec<OpeningPlace>), InputError> {
    let read: (Header, Vec<OpeningPlace>) =
        borsh::from_slice(bytes).map_err(|_| InputError::Header)?;
    read.0.spec.validate()?;
    Ok(read)
}

/// The samples, one after another.
fn samples(openings: &[Opening]) -> Vec<u8> {
    let samples: Vec<&[u8]> = openings
        .iter()
        .map(|opening| opening.sample.as_bytes())
        .collect();
    samples.concat()
}

/// Reads [`samples`].
fn read_samples(
    spec: &EvalSpec,
    places: Vec<OpeningPlace>,
    samples: &[u8],
) -> Result<Vec<Opening>, InputError> {
    let mut rest = samples;
    let mut openings = Vec::with_capacity(places.len());
    for (position, (index, path)) in places.into_iter().enumerate() {
        let (sample, later) = Sample::split_from(&spec.dims, rest)
            .map_err(|error| InputError::Sample { position, error })?;
        rest = later;
        openings.push(Opening {
            index,
            sample,
            path,
        });
    }
    if !rest.is_empty() {
        return Err(InputError::TrailingBytes(rest.len()));
    }
    Ok(openings)
}
