//! What the guest program of mode `succinct` reads, and its encoding as buffers.

use alloc::borrow::Cow;
use alloc::vec::Vec;
use borsh::{BorshDeserialize, BorshSerialize};
use zk0_circuits::claim::private_input::{Header, InputError};
use zk0_circuits::Digest;

/// The input. Whoever sees it learns the losses on each sample, how long the samples are, whether the base saturates or scores of either model lie
/// too far apart, and the salt. From the losses and a guess of a sample follows whether the guess may be right. It shows nothing else of samples.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ClaimInput<'a> {
    /// Specification, terms, salt.
    pub header: Header,
    /// Fraction bits of each of the expert's tensors, for the base and the update.
    pub scales: [Vec<i16>; 2],
    /// Whether a value of the base saturates on one of the samples ([`crate::expert::statement::Statement::saturates`]).
    pub saturates: bool,
    /// In the order the challenge draws them.
    pub openings: Vec<SampleOpening>,
    /// The argument about the losses, in words.
    pub argument: Cow<'a, [u64]>,
}

/// An evaluated sample, and its place in the dataset.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct SampleOpening {
    /// Index in the dataset.
    pub index: u64,
    /// RFC 6962 inclusion path of its leaf.
    pub path: Vec<Digest>,
    /// Valid tokens of the prefix.
    pub prefix: u32,
    /// Frames up to the last one that is not padding.
    pub frames: u32,
    /// The sums of squared errors of the base and the update.
    pub losses: [u64; 2],
}

/// Number of buffers of an encoded input.
pub const CLAIM_BUFFERS: usize = 2;

impl<'a> ClaimInput<'a> {
    /// Encodes the input as two buffers: header, scales, whether the base saturates, and openings (borsh); the words of the argument, little-endian.
    pub fn to_buffers(&self) -> [Vec<u8>; CLAIM_BUFFERS] {
        // Writing to memory does not fail.
        let head = (&self.header, &self.scales, self.saturates, &self.openings);
        let head = borsh::to_vec(&head).unwrap_or_default();
        let words = self.argument.iter().flat_map(|word| word.to_le_bytes());
        [head, words.collect()]
    }

    /// Reads what [`Self::to_buffers`] wrote. It trusts no length in the buffers. Where the argument is aligned to 8 bytes, it is not copied.
    pub fn from_buffers<B: AsRef<[u8]>>(buffers: &'a [B]) -> Result<Self, InputError> {
        let [head, argument] = buffers else {
            return Err(InputError::Buffers {
                found: buffers.len(),
                expected: CLAIM_BUFFERS,
            });
        };
        let (header, scales, saturates, openings): (Header, _, _, _) =
            borsh::from_slice(head.as_ref()).map_err(|_| InputError::Header)?;
        header.spec.validate()?;
        Ok(Self {
            header,
            scales,
            saturates,
            openings,
            argument: words(argument.as_ref())?,
        })
    }
}

/// Bytes as words, borrowed where they are aligned.
fn words(bytes: &[u8]) -> Result<Cow<'_, [u64]>, InputError> {
    let (words, rest) = bytes.as_chunks::<8>();
    if !rest.is_empty() {
        return Err(InputError::TrailingBytes(rest.len()));
    }
    Ok(match bytemuck::try_cast_slice(bytes) {
        Ok(words) => Cow::Borrowed(words),
        Err(_) => words.iter().map(|word| u64::from_le_bytes(*word)).collect(),
    })
}
