//! The evaluation set of a dataset: the frames of a recording that a node commits to, and their leaves.
//!
//! A recording has more frames than a node can commit to. So a registration names all episodes, and their hash draws the frames.
//! No node chooses them, and anybody can redraw them.
//!
//! Frames are counted from 0 through the episodes, in the registration's order.

use crate::entries::signed::{DatasetRegistration, RegisteredEpisode};
use std::collections::BTreeSet;
use zk0_circuits::claim::challenge::{sample_indices, DrawError};
use zk0_circuits::vm::digest::tagged_sha256;
use zk0_circuits::Digest;

/// Bytes of a [`DrawnLeaf`] in a list.
pub const DRAWN_LEAF_BYTES: usize = 40;

/// A drawn frame and the leaf of its sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DrawnLeaf {
    /// The frame.
    pub frame: u64,
    /// The leaf hash of its sample.
    pub leaf: Digest,
}

/// Why a registration or its list is refused. The texts are data of the ledger: see [`crate::Refusal`].
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EvaluationSetError {
    /// It does not draw the rules' number of frames.
    #[error("its evaluation set draws {given} frames, but the rules ask for {rule}")]
    Frames {
        /// Frames in the registration.
        given: u32,
        /// Frames by the rules.
        rule: u32,
    },
    /// An episode has no frames.
    #[error("episode {0} has no frames")]
    EmptyEpisode(Digest),
    /// It counts more samples than drawn frames.
    #[error("it counts {samples} samples, but only {drawn} frames are drawn")]
    TooManySamples {
        /// Samples in the commitment.
        samples: u64,
        /// Frames drawn.
        drawn: u64,
    },
    /// The list does not have one record for each frame.
    #[error(
        "the list of drawn frames has {bytes} bytes, but {drawn} frames are drawn, of {DRAWN_LEAF_BYTES} bytes each"
    )]
    Length {
        /// Bytes in the list.
        bytes: usize,
        /// Frames drawn.
        drawn: u64,
    },
    /// The list has a frame that was not drawn for this place.
    #[error("frame {listed} stands at place {place} of the list, but the hash of the episodes draws frame {drawn} there: nobody chooses the frames")]
    NotDrawn {
        /// The place, from 0.
        place: usize,
        /// The frame in the list.
        listed: u64,
        /// The drawn frame.
        drawn: u64,
    },
    /// The commitment has another count than the distinct leaves.
    #[error("the drawn frames have {distinct} distinct samples, but the dataset commitment counts {samples}")]
    Count {
        /// Distinct leaves in the list.
        distinct: u64,
        /// Samples in the commitment.
        samples: u64,
    },
    /// No frames can be drawn.
    #[error(transparent)]
    Draw(#[from] DrawError),
}

/// Draws the frames of an evaluation set, in ascending order: `count` of them, or all if there are no more.
///
/// The seed is [`tagged_sha256`] under `zk0/evaluation-set/v1` of the network's id and the episodes, each as digest and number of
/// frames (32-bit little-endian). [`sample_indices`] draws distinct frames from it. A larger count only adds frames.
///
/// # Errors
/// `count` is 0, or above the limit of [`sample_indices`].
pub fn draw(
    network: &Digest,
    episodes: &[RegisteredEpisode],
    count: u32,
) -> Result<Vec<u64>, DrawError> {
    let frames = total(episodes);
    if frames <= u64::from(count) {
        return Ok((0..frames).collect());
    }
    let each = episodes.iter().flat_map(|episode| {
        let frames = episode.frames.to_le_bytes();
        episode.digest.0.into_iter().chain(frames)
    });
    let all: Vec<u8> = each.collect();
    let seed = tagged_sha256("zk0/evaluation-set/v1", &[&network.0, &all]);
    let mut drawn = sample_indices(&seed, frames, count)?;
    drawn.sort_unstable();
    Ok(drawn)
}

/// The frames of all episodes.
pub fn total(episodes: &[RegisteredEpisode]) -> u64 {
    episodes
        .iter()
        .map(|episode| u64::from(episode.frames))
        .sum()
}

impl DatasetRegistration {
    /// How many frames are drawn.
    pub fn drawn(&self) -> u64 {
        total(&self.episodes).min(self.evaluation_frames.into())
    }

    /// Checks the evaluation set without its list. `rule` is the rules' number of frames. Only the list shows equal samples.
    pub fn check_evaluation_set(&self, rule: u32) -> Result<(), EvaluationSetError> {
        let (given, samples, drawn) = (self.evaluation_frames, self.dataset.samples, self.drawn());
        if given != rule {
            return Err(EvaluationSetError::Frames { given, rule });
        }
        if let Some(empty) = self.episodes.iter().find(|episode| episode.frames == 0) {
            return Err(EvaluationSetError::EmptyEpisode(empty.digest));
        }
        if samples > drawn {
            Err(EvaluationSetError::TooManySamples { samples, drawn })
        } else {
            Ok(())
        }
    }

    /// Reads the list: exactly the drawn frames, in ascending order, with as many [`distinct`] leaves as the commitment counts
    /// samples.
    pub fn read_list(&self, list: &[u8]) -> Result<Vec<DrawnLeaf>, EvaluationSetError> {
        let length = EvaluationSetError::Length {
            bytes: list.len(),
            drawn: self.drawn(),
        };
        let (records, rest) = list.as_chunks::<DRAWN_LEAF_BYTES>();
        // The length comes first, so a list costs no more than its bytes.
        if !rest.is_empty() || records.len() as u64 != self.drawn() {
            return Err(length);
        }
        let drawn = draw(&self.network, &self.episodes, self.evaluation_frames)?;
        let mut listed = Vec::with_capacity(records.len());
        for (place, (record, drawn)) in records.iter().zip(drawn).enumerate() {
            let record = DrawnLeaf::from_bytes(record);
            if record.frame != drawn {
                let listed = record.frame;
                return Err(EvaluationSetError::NotDrawn {
                    place,
                    listed,
                    drawn,
                });
            }
            listed.push(record);
        }
        let (distinct, samples) = (distinct(&listed).len() as u64, self.dataset.samples);
        if distinct == samples {
            Ok(listed)
        } else {
            Err(EvaluationSetError::Count { distinct, samples })
        }
    }
}

impl DrawnLeaf {
    /// The frame (64-bit little-endian) and the leaf.
    pub fn to_bytes(&self) -> [u8; DRAWN_LEAF_BYTES] {
        let mut bytes = [0; DRAWN_LEAF_BYTES];
        let (frame, leaf) = bytes.split_at_mut(8);
        frame.copy_from_slice(&self.frame.to_le_bytes());
        leaf.copy_from_slice(&self.leaf.0);
        bytes
    }

    fn from_bytes(bytes: &[u8; DRAWN_LEAF_BYTES]) -> Self {
        let (mut frame, mut leaf) = ([0; 8], [0; 32]);
        frame.copy_from_slice(&bytes[..8]);
        leaf.copy_from_slice(&bytes[8..]);
        Self {
            frame: u64::from_le_bytes(frame),
            leaf: Digest(leaf),
        }
    }
}

/// The list as the blob that a registration names.
pub fn list_bytes(list: &[DrawnLeaf]) -> Vec<u8> {
    list.iter().flat_map(DrawnLeaf::to_bytes).collect()
}

/// The leaves of the dataset's tree: the list's, each at its first place. A still camera and a resting robot give equal samples.
pub fn distinct(list: &[DrawnLeaf]) -> Vec<Digest> {
    let mut seen = BTreeSet::new();
    let leaves = list.iter().map(|drawn| drawn.leaf);
    leaves.filter(|leaf| seen.insert(*leaf)).collect()
}
