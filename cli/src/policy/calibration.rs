//! Samples from recordings, and fixed-point ranges chosen from them.

use crate::dataset::{of_recording, RecordingName};
use anyhow::{Context, Result};
use zk0_circuits::{Digest, EvalSpec};
use zk0_smolvla::frames::sample::{PreparedSample, Preparer};
use zk0_smolvla::measure::calibrate::{calibrate, Magnitudes};
use zk0_smolvla::measure::fidelity::draws;
use zk0_smolvla::measure::fixed_point::dims;
use zk0_smolvla::policy::policy_file::PolicyFile;
use zk0_smolvla::{ExpertWeights, PolicyConfig};

/// Noises and times for each sample.
const DRAWS: usize = 2;

/// At most `frames` evenly spaced frames of each recording, through the policy's frozen half.
pub fn samples(
    file: &PolicyFile,
    recordings: &[RecordingName],
    frames: usize,
) -> Result<Vec<PreparedSample>> {
    let each = recordings.iter().map(|recording| (recording, frames));
    samples_of(file, each)
}

/// As [`samples`], with a number for each recording, at least one.
pub fn samples_of<'a>(
    file: &PolicyFile,
    recordings: impl Iterator<Item = (&'a RecordingName, usize)>,
) -> Result<Vec<PreparedSample>> {
    let preparer = Preparer::new(&file.policy, &file.tokenizer)?;
    let mut samples = Vec::new();
    for (recording, frames) in recordings {
        let dataset = recording.open()?;
        let wanted = evenly(dataset.len(), frames.max(1));
        let prepared = preparer.prepare_frames(&dataset, wanted, |done, of| {
            tracing::debug!("{recording}: {done} of {of} frames prepared");
        });
        samples.extend(prepared.map_err(|error| of_recording(error.into(), recording))?);
    }
    Ok(samples)
}

/// At most `count`, evenly spaced.
fn evenly(len: usize, count: usize) -> impl ExactSizeIterator<Item = usize> {
    let count = count.min(len);
    (0..count).map(move |place| place * len / count)
}

/// The evaluation whose ranges hold all values of `weights` on `samples`, with headroom.
pub fn calibrated(
    config: &PolicyConfig,
    weights: &ExpertWeights,
    samples: &[PreparedSample],
) -> Result<EvalSpec> {
    let dims = dims(config)?;
    // Not the challenge of a comparison of losses.
    let draws = draws(
        &EvalSpec::new(dims),
        &Digest([0xca; 32]),
        DRAWS * samples.len(),
    );
    let pairs: Vec<_> = samples.iter().cycle().zip(&draws).collect();
    let (magnitudes, _) = Magnitudes::observe(config, weights, &pairs)?;
    calibrate(dims, &magnitudes).context("choosing ranges")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn as_many_frames_are_taken_as_are_asked_for() {
        let taken = |len, count| evenly(len, count).collect::<Vec<_>>();
        for count in [1, 2, 32, 100, 200, 245] {
            let frames = taken(245, count);
            assert_eq!(frames.len(), count);
            assert_eq!(frames[0], 0);
            let gaps: Vec<_> = frames.windows(2).map(|pair| pair[1] - pair[0]).collect();
            let (least, most) = (245 / count, 245_usize.div_ceil(count));
            assert!(
                gaps.iter().all(|gap| (least..=most).contains(gap)),
                "{gaps:?}"
            );
            assert!(frames[count - 1] < 245);
        }
        assert_eq!(taken(245, 246), (0..245).collect::<Vec<_>>());
        assert!(taken(0, 1).is_empty());
    }
}
