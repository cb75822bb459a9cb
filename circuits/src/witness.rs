//! The witness of a claim and its encoding as flat byte buffers, cheap to read in the guest.

use crate::{
    dataset::leaf,
    sample::{Sample, SampleError},
    spec::{EvalSpec, SpecError},
    statement::Disclosure,
    weights::{QuantisedWeights, WeightsError},
    DatasetCommitment, Digest, NodeId, WeightsDigest,
};
use alloc::vec::Vec;
use borsh::{BorshDeserialize, BorshSerialize};

/// The small part of a witness: what becomes the claim, the specification, and the dataset's secret salt.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Header {
    /// Evaluation specification of the round.
    pub spec: EvalSpec,
    /// Digest of the network's genesis.
    pub network: Digest,
    /// Round.
    pub round: u64,
    /// Contributing node.
    pub node: NodeId,
    /// Its dataset commitment.
    pub dataset: DatasetCommitment,
    /// Weights the round started from.
    pub base: WeightsDigest,
    /// Weights contributed.
    pub update: WeightsDigest,
    /// See [`crate::challenge::challenge`].
    pub challenge: Digest,
    /// Samples to evaluate.
    pub eval_samples: u32,
    /// Least improvement, in basis points.
    pub min_improvement_bps: u32,
    /// What the claim says of the losses.
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

/// All that [`crate::statement::check`] needs, in mode `direct`. Private: it holds samples and salt.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Witness {
    /// Claim fields, specification, salt.
    pub header: Header,
    /// Weights the round started from.
    pub base: QuantisedWeights,
    /// Weights contributed.
    pub update: QuantisedWeights,
    /// In the order the challenge draws them.
    pub openings: Vec<Opening>,
}

/// Number of buffers of an encoded witness.
pub const WITNESS_BUFFERS: usize = 4;

/// Why buffers are not a witness.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum WitnessError {
    /// Wrong number of buffers.
    #[error("this witness is {expected} buffers, got {found}")]
    Buffers {
        /// Buffers there.
        found: usize,
        /// Buffers needed.
        expected: usize,
    },
    /// The first buffer is not a header with index and path per opening.
    #[error("the first buffer is not a witness header")]
    Header,
    /// The specification is refused.
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

impl Witness {
    /// The four buffers: header, indices and paths (borsh); base weights; update weights; samples one after another (each
    /// raw little-endian int16, padded to 8 bytes).
    pub fn to_buffers(&self) -> [Vec<u8>; WITNESS_BUFFERS] {
        [
            head(&self.header, &(), &self.openings),
            self.base.as_bytes().to_vec(),
            self.update.as_bytes().to_vec(),
            samples(&self.openings),
        ]
    }

    /// Reads what [`Self::to_buffers`] wrote; trusts no length in it, and validates the specification first, so that
    /// nothing larger than the buffers is allocated.
    pub fn from_buffers<B: AsRef<[u8]>>(buffers: &[B]) -> Result<Self, WitnessError> {
        let [head, base, update, samples] = buffers else {
            return Err(WitnessError::Buffers {
                found: buffers.len(),
                expected: WITNESS_BUFFERS,
            });
        };
        let (header, (), places) = read_head(head.as_ref())?;
        let weights = |which, bytes: &B| {
            QuantisedWeights::from_bytes(&header.spec, bytes.as_ref())
                .map_err(|error| WitnessError::Weights { which, error })
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

/// Header, what is in between, and per opening index and path.
pub(crate) fn head<T: BorshSerialize>(
    header: &Header,
    between: &T,
    openings: &[Opening],
) -> Vec<u8> {
    let places: Vec<(u64, &Vec<Digest>)> = openings
        .iter()
        .map(|opening| (opening.index, &opening.path))
        .collect();
    // Writing to memory does not fail.
    borsh::to_vec(&(header, between, places)).unwrap_or_default()
}

/// Reads [`head`] and validates the specification.
pub(crate) fn read_head<T: BorshDeserialize>(
    bytes: &[u8],
) -> Result<(Header, T, Vec<OpeningPlace>), WitnessError> {
    let read: (Header, T, Vec<OpeningPlace>) =
        borsh::from_slice(bytes).map_err(|_| WitnessError::Header)?;
    read.0.spec.validate()?;
    Ok(read)
}

/// The samples, one after another.
pub(crate) fn samples(openings: &[Opening]) -> Vec<u8> {
    let samples: Vec<&[u8]> = openings
        .iter()
        .map(|opening| opening.sample.as_bytes())
        .collect();
    samples.concat()
}

/// Reads [`samples`].
pub(crate) fn read_samples(
    spec: &EvalSpec,
    places: Vec<OpeningPlace>,
    samples: &[u8],
) -> Result<Vec<Opening>, WitnessError> {
    let mut rest = samples;
    let mut openings = Vec::with_capacity(places.len());
    for (position, (index, path)) in places.into_iter().enumerate() {
        let (sample, later) = Sample::split_from(&spec.dims, rest)
            .map_err(|error| WitnessError::Sample { position, error })?;
        rest = later;
        openings.push(Opening {
            index,
            sample,
            path,
        });
    }
    if !rest.is_empty() {
        return Err(WitnessError::TrailingBytes(rest.len()));
    }
    Ok(openings)
}
