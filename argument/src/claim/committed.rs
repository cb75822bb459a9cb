//! What a node commits to of a sample.

use super::cost::dearest_scales;
use crate::expert::argument::prove::has_room;
use crate::expert::blinding::Blind;
use crate::expert::sample::prove::{digest, uses};
use crate::expert::statement::{Statement, MOST_SAMPLES};
use zk0_circuits::{Digest, EvalSpec, Mode, Sample};

/// The digest of a sample, from which its leaf follows ([`zk0_circuits::claim::dataset::leaf`]). In mode `succinct` it is that of a commitment to
/// all values, which takes about a second at the published size, and which `blind` hides.
pub fn committed(mode: Mode, spec: &EvalSpec, sample: &Sample, blind: &Blind) -> Digest {
    match mode {
        Mode::Direct => sample.digest(),
        Mode::Succinct => digest(spec, sample, blind).into(),
    }
}

/// Most samples of a claim, beside what the rules allow. In mode `succinct` there are pads for each in one column, which is shorter where samples are
/// small, and fewer with some weights than with others: this many fit with all. At the published size the statement's own limit comes first.
pub fn most_samples(mode: Mode, spec: &EvalSpec) -> u32 {
    if mode != Mode::Succinct {
        return u32::MAX;
    }
    let evaluated = Statement {
        saturates: true,
        ..Statement::of_weights(spec, dearest_scales(spec))
    };
    let fits = |samples: usize| {
        let mut statement = evaluated.clone();
        statement
            .samples
            .resize(samples, evaluated.samples[0].clone());
        has_room(&statement).unwrap_or(false)
    };
    let all: Vec<usize> = (1..=MOST_SAMPLES).collect();
    all.partition_point(|&samples| fits(samples)) as u32
}

/// How many arguments may open a sample. Its commitment hides it as long as no more rows are open than these have positions.
pub fn most_uses(spec: &EvalSpec) -> u32 {
    uses(spec)
}
