//! What a node commits to of a sample.

use crate::expert::blinding::Blind;
use crate::expert::sample::prove::{digest, uses};
use zk0_circuits::{Digest, EvalSpec, Mode, Sample};

/// The digest of a sample, from which its leaf follows ([`zk0_circuits::claim::dataset::leaf`]). In mode `succinct` it is that of a commitment to
/// all values, which takes about a second at the published size, and which `blind` hides.
pub fn committed(mode: Mode, spec: &EvalSpec, sample: &Sample, blind: &Blind) -> Digest {
    match mode {
        Mode::Direct => sample.digest(),
        Mode::Succinct => digest(spec, sample, blind).into(),
    }
}

/// How many arguments may open a sample. Its commitment hides it as long as no more rows are open than these have positions.
pub fn most_uses(spec: &EvalSpec) -> u32 {
    uses(spec)
}
