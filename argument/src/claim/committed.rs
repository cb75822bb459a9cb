//! What a node commits to of a sample.

use crate::expert::sample::prove::digest;
use zk0_circuits::{Digest, EvalSpec, Mode, Sample};

/// An evaluation has too few values for the commitment of mode `succinct`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("a sample of this evaluation has too few values for mode succinct: use mode direct")]
pub struct TooSmall;

/// The digest of a sample, from which its leaf follows ([`zk0_circuits::claim::dataset::leaf`]). In mode `succinct` it is that of a commitment to
/// all values, which takes about a second at the published size.
///
/// # Errors
/// The evaluation is too small for mode `succinct`.
pub fn committed(mode: Mode, spec: &EvalSpec, sample: &Sample) -> Result<Digest, TooSmall> {
    match mode {
        Mode::Direct => Ok(sample.digest()),
        Mode::Succinct => digest(spec, sample).map(Into::into).ok_or(TooSmall),
    }
}
