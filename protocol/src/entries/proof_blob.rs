//! The blob of a contribution's proof: its weight check, if any, and the SP1 proof.

use zk0_circuits::Claim;

/// A proof blob's parts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ProofBlob<'a> {
    /// The preimage of [`Claim::weight_check`]. Empty in mode `direct`.
    pub weight_check: &'a [u8],
    /// The SP1 compressed proof.
    pub sp1: &'a [u8],
}

/// A blob is too short for its claim's weight check.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("it has {0} bytes, too few for the weight check that its claim names")]
pub struct TooShort(usize);

impl<'a> ProofBlob<'a> {
    /// Splits the blob with the proof of `claim`: without a weight check in the claim, all of it is the SP1 proof; else it begins
    /// with the weight check, after its length as a little-endian u32.
    pub fn split(claim: &Claim, blob: &'a [u8]) -> Result<Self, TooShort> {
        if claim.weight_check.is_none() {
            let weight_check = &[];
            return Ok(Self {
                weight_check,
                sp1: blob,
            });
        }
        let too_short = || TooShort(blob.len());
        let (length, rest) = blob.split_first_chunk::<4>().ok_or_else(too_short)?;
        let length = u32::from_le_bytes(*length) as usize;
        let (weight_check, sp1) = rest.split_at_checked(length).ok_or_else(too_short)?;
        Ok(Self { weight_check, sp1 })
    }

    /// The blob.
    pub fn join(&self) -> Vec<u8> {
        if self.weight_check.is_empty() {
            self.sp1.to_vec()
        } else {
            let length = (self.weight_check.len() as u32).to_le_bytes();
            [&length, self.weight_check, self.sp1].concat()
        }
    }
}
