//! Samples from recordings, and the ranges of fixed-point numbers that are chosen from them, for `zk0 fidelity` and
//! `zk0 aggregator init --calibrate`.

use crate::dataset::RecordingName;
use anyhow::{Context, Result};
use zk0_circuits::{Digest, EvalSpec};
use zk0_smolvla::frames::sample::{PreparedSample, Preparer};
use zk0_smolvla::measure::calibrate::{calibrate, Magnitudes};
use zk0_smolvla::measure::fidelity::draws;
use zk0_smolvla::measure::fixed_point::dims;
use zk0_smolvla::policy::policy_file::PolicyFile;
use zk0_smolvla::{ExpertWeights, PolicyConfig};

/// The number of noises and times with which each sample is evaluated.
const DRAWS: usize = 2;

/// At most `frames` frames of each recording, evenly spaced, through the frozen half of a policy.
pub fn samples(
    file: &PolicyFile,
    recordings: &[RecordingName],
    frames: usize,
) -> Result<Vec<PreparedSample>> {
    let preparer = Preparer::new(&file.policy, &file.tokenizer)?;
    let mut samples = Vec::new();
    for recording in recordings {
        let dataset = recording.open()?;
        let step = dataset.len().div_ceil(frames.max(1));
        let prepared = preparer.prepare_every(&dataset, step, |done, of| {
            tracing::debug!("{recording}: {done} of {of} frames prepared");
        });
        samples.extend(prepared.with_context(|| format!("recording {recording}"))?);
    }
    Ok(samples)
}

/// The evaluation whose ranges hold all values that `weights` compute from `samples`, with headroom.
pub fn calibrated(
    config: &PolicyConfig,
    weights: &ExpertWeights,
    samples: &[PreparedSample],
) -> Result<EvalSpec> {
    let dims = dims(config)?;
    // Any challenge will do, except one that a comparison of losses uses, too.
    let draws = draws(
        &EvalSpec::new(dims),
        &Digest([0xca; 32]),
        DRAWS * samples.len(),
    );
    let pairs: Vec<_> = samples.iter().cycle().zip(&draws).collect();
    let (magnitudes, _) = Magnitudes::observe(config, weights, &pairs)?;
    calibrate(dims, &magnitudes).context("choosing ranges")
}
