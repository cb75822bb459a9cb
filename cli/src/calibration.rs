//! Samples from recordings for `zk0 fidelity` and `zk0 aggregator init --calibrate`, and the ranges chosen from them.

use anyhow::{Context, Result};
use std::path::PathBuf;
use zk0_circuits::{Digest, EvalSpec};
use zk0_smolvla::{
    calibrate::{calibrate, Magnitudes},
    dataset::Dataset,
    fidelity::draws,
    fixed_point::dims,
    sample::{PreparedSample, Preparer},
    tokenizer::WordHash,
    ExpertWeights, Policy, PolicyConfig,
};

/// Noises and times that each sample is seen at.
const DRAWS: usize = 2;

/// At most `frames` frames of each recording, evenly spaced, through the frozen half of `policy`.
pub fn samples(
    policy: &Policy,
    recordings: &[PathBuf],
    frames: usize,
) -> Result<Vec<PreparedSample>> {
    let tokenizer = WordHash::new(&policy.config);
    let preparer = Preparer::new(policy, &tokenizer)?;
    let mut samples = Vec::new();
    for path in recordings {
        let prepared = Dataset::open(path).map_err(Into::into).and_then(|dataset| {
            let step = dataset.len().div_ceil(frames.max(1));
            preparer.prepare_every(&dataset, step, |done, of| {
                tracing::debug!("{}: {done} of {of} frames prepared", path.display());
            })
        });
        samples.extend(prepared.with_context(|| format!("recording {}", path.display()))?);
    }
    Ok(samples)
}

/// The specification whose ranges hold all that `weights` make of `samples`, with headroom.
pub fn calibrated(
    config: &PolicyConfig,
    weights: &ExpertWeights,
    samples: &[PreparedSample],
) -> Result<EvalSpec> {
    let dims = dims(config)?;
    // Any challenge will do, but not one that a comparison of losses uses too.
    let draws = draws(
        &EvalSpec::new(dims),
        &Digest([0xca; 32]),
        DRAWS * samples.len(),
    );
    let pairs: Vec<_> = samples.iter().cycle().zip(&draws).collect();
    let (magnitudes, _) = Magnitudes::observe(config, weights, &pairs)?;
    calibrate(dims, &magnitudes).context("choosing ranges")
}
