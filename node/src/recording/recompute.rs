//! An auditor with a node's recording and secret draws the frames, makes their samples, and compares the leaves.

use crate::error::ParticipantError;
use crate::progress::Progress;
use crate::recording::secret::Secrets;
use crate::recording::OpenRecording;
use zk0_argument::claim::committed;
use zk0_circuits::claim::dataset::leaf;
use zk0_circuits::{Digest, EvalSpec, Mode};
use zk0_protocol::entries::signed::{DatasetRegistration, RegisteredEpisode};
use zk0_protocol::evaluation_set::DrawnLeaf;
use zk0_smolvla::frames::batch::SampleSource;
use zk0_smolvla::frames::sample::PreparedSample;
use zk0_smolvla::measure::fixed_point::quantise_sample;

const NAMED: usize = 8;

/// What an auditor found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Recomputed {
    /// All samples agree.
    Same {
        /// Frames compared.
        frames: u64,
    },
    /// None of the secrets is the registration's.
    OtherSecret,
    /// The recording has other features.
    OtherFeatures {
        /// Those of the recording.
        found: Digest,
    },
    /// The recording has other episodes.
    OtherEpisodes {
        /// Registered, but not in the recording with this many frames.
        missing: Vec<Digest>,
        /// In the recording, but not registered with this many frames.
        extra: Vec<Digest>,
    },
    /// Frames of the recording give other samples.
    OtherSamples {
        /// The first differing frames, as the registration counts them.
        frames: Vec<u64>,
        /// How many differ.
        differ: u64,
        /// How many were compared.
        of: u64,
    },
}

/// Compares a registration, whose checked list of drawn frames is `list`, with the recording. `samples` are all its frames; one is in
/// memory at a time.
///
/// # Errors
/// The recording or the policy cannot be read, or a sample does not fit the specification.
pub fn recompute(
    recording: &OpenRecording,
    samples: &dyn SampleSource<PreparedSample>,
    (mode, spec): (Mode, &EvalSpec),
    registration: &DatasetRegistration,
    list: &[DrawnLeaf],
    secrets: &Secrets,
) -> Result<Recomputed, ParticipantError> {
    let Some(secret) = secrets.of(&registration.dataset) else {
        return Ok(Recomputed::OtherSecret);
    };
    let (salt, blind) = (secret.salt(), secret.blind());
    let found = recording.feature_spec();
    if found != registration.dataset.feature_spec {
        return Ok(Recomputed::OtherFeatures { found });
    }
    let own = recording.episodes();
    if own != registration.episodes {
        let other = |all: &[RegisteredEpisode], among: &[RegisteredEpisode]| {
            let others = all.iter().filter(|episode| !among.contains(episode));
            others.map(|episode| episode.digest).collect()
        };
        return Ok(Recomputed::OtherEpisodes {
            missing: other(&registration.episodes, &own),
            extra: other(&own, &registration.episodes),
        });
    }
    let of = list.len() as u64;
    let mut progress = Progress::start("comparing samples", of);
    let (mut frames, mut differ) = (Vec::new(), 0);
    for (done, listed) in (1..).zip(list) {
        let same = match recording.frame(listed.frame) {
            Some(place) => {
                let sample = quantise_sample(spec, samples.sample(place)?.as_ref())?;
                leaf(&salt, &committed(mode, spec, &sample, &blind).digest) == listed.leaf
            }
            None => false,
        };
        if !same {
            differ += 1;
            if frames.len() < NAMED {
                frames.push(listed.frame);
            }
        }
        progress.reached(done);
    }
    Ok(match differ {
        0 => Recomputed::Same { frames: of },
        _ => Recomputed::OtherSamples { frames, differ, of },
    })
}
