//! The blob with a contribution's proof: what the proof leaves to check of the weights, if there is something, and then the SP1 proof.

use zk0_circuits::Claim;

/// The parts of a blob with a proof.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ProofBlob<'a> {
    /// What [`Claim::weight_check`] is the digest of. Nothing in mode `direct`.
    pub weight_check: &'a [u8],
    /// The SP1 compressed proof.
    pub sp1: &'a [u8],
}

/// A blob is too short for the weight check that its claim names.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("it has {0} bytes, too few for the weight check that its claim names")]
pub struct TooShort(usize);

impl<'a> ProofBlob<'a> {
    /// Splits the blob with the proof of `claim`. Where the claim names no weight check, all of it is the SP1 proof. Otherwise, it begins with
    /// the length of the weight check as a little-endian u32, and with the weight check.
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
