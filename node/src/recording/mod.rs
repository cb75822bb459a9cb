//! A node's own recording. It trains on all frames, and commits to the samples of those that are drawn.
//!
//! - [`OpenRecording`]: the recording and its frames as samples, made when needed or read from the cache.
//! - [`evaluation_set`]: the drawn samples in fixed point, and the commitment to them; [`sample_files`]: these samples on disk;
//!   [`opened_samples`]: those of a claim.
//! - [`secret`]: what hides the samples, and how often they were opened; [`registering`]: puts the commitment on the ledger, and another
//!   one before the secret is worn out.
//! - [`agreement`]: whether the recording fits the network's rules.
//! - [`recompute`]: an auditor's check of a registration.

pub mod agreement;
pub mod evaluation_set;
pub mod opened_samples;
pub mod recompute;
pub mod registering;
pub mod sample_files;
pub mod secret;

use crate::error::ParticipantError;
use crate::samples::prepare;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::slice;
use zk0_circuits::Digest;
use zk0_lerobot::dataset::{CopiedEpisodes, Dataset};
use zk0_protocol::entries::signed::RegisteredEpisode;
use zk0_smolvla::frames::image_transforms::Variants;
use zk0_smolvla::frames::prefix_cache::{
    CacheKey, DiskCache, FrameMaker, FrameNames, FrameRef, FrameSource, KeySpace,
};
use zk0_smolvla::frames::sample::{PreparedSample, Preparer};
use zk0_smolvla::policy::frozen::FrozenPlace;
use zk0_smolvla::policy::policy_file::{self, PolicyFile};
use zk0_smolvla::policy::tokenizer::PolicyTokenizer;
use zk0_smolvla::{PolicyConfig, PolicyError};

/// An open recording, with the policy that makes samples of its frames.
pub struct OpenRecording<'c> {
    dataset: Dataset,
    policy: PathBuf,
    config: PolicyConfig,
    tokenizer: PolicyTokenizer,
    cache: Option<&'c DiskCache>,
    frames: Vec<FrameRef>,
    episodes: Vec<Placed>,
}

struct Placed {
    episode: RegisteredEpisode,
    /// Its first frame, as registrations count frames.
    first: u64,
    /// Its first frame in the recording.
    start: usize,
}

impl<'c> OpenRecording<'c> {
    /// Opens the LeRobotDataset in `path`. The policy in the file `policy` makes samples of its frames; its tokenizer reads the
    /// instructions. Samples in `cache` are not computed again; they are the same bits.
    ///
    /// # Errors
    /// The recording, the policy or the cache cannot be read.
    pub fn open(
        path: &Path,
        policy: &Path,
        cache: Option<&'c DiskCache>,
    ) -> Result<Self, ParticipantError> {
        Self::of(Dataset::open(path)?, policy, cache)
    }

    /// [`Self::open`] for an open dataset.
    ///
    /// # Errors
    /// The policy or the cache cannot be read.
    pub fn of(
        dataset: Dataset,
        policy: &Path,
        cache: Option<&'c DiskCache>,
    ) -> Result<Self, ParticipantError> {
        for copied in CopiedEpisodes::among([&dataset]) {
            tracing::warn!("{copied}");
        }
        let file = policy_file::load(policy)?;
        let frames = named_frames(&dataset, &file, cache)?;
        let episodes = placed(&dataset)?;
        // The weights take gigabytes, and are read again for the first sample.
        let PolicyFile {
            policy: weights,
            tokenizer,
        } = file;
        Ok(Self {
            dataset,
            policy: policy.into(),
            config: weights.config,
            tokenizer,
            cache,
            frames,
            episodes,
        })
    }

    /// The policy's configuration.
    pub fn config(&self) -> &PolicyConfig {
        &self.config
    }

    /// The number of its frames.
    pub fn len(&self) -> usize {
        self.frames.len()
    }

    /// Always `false`: a recording without frames cannot be opened.
    pub fn is_empty(&self) -> bool {
        self.frames.is_empty()
    }

    /// Its episodes as a registration names them: in ascending order of their digests, each once.
    pub fn episodes(&self) -> Vec<RegisteredEpisode> {
        self.episodes.iter().map(|placed| placed.episode).collect()
    }

    /// Digest of its features.
    pub fn feature_spec(&self) -> Digest {
        Digest(self.dataset.feature_spec_digest(self.config.chunk_size))
    }

    /// The recording's frame that registrations call `frame`; `None` if there is no such frame.
    pub fn frame(&self, frame: u64) -> Option<usize> {
        let at = self
            .episodes
            .partition_point(|placed| placed.first <= frame)
            .checked_sub(1)?;
        let Placed {
            episode,
            first,
            start,
        } = &self.episodes[at];
        let within = frame - first;
        (within < u64::from(episode.frames)).then(|| start + within as usize)
    }

    /// A name of all that decides the sample.
    fn key(&self, frame: usize) -> CacheKey {
        self.frames[frame].key
    }

    /// Makes samples of frames. The first one reads the frozen half of the policy.
    pub fn maker(&self) -> FrameMaker<'_> {
        let load = move || {
            let file = policy_file::load(&self.policy)?;
            Preparer::at(&FrozenPlace::default(), file.policy, &self.tokenizer)
        };
        FrameMaker::new(slice::from_ref(&self.dataset), self.config.chunk_size, load)
    }

    /// All frames as samples, one at a time: from the cache, or else made, and kept there up to its budget.
    pub fn samples<'m, 's>(
        &'s self,
        maker: &'m FrameMaker<'s>,
    ) -> FrameSource<'m, 's, PreparedSample>
    where
        'c: 'm,
    {
        FrameSource::new(self.cache, maker, self.frames.clone())
    }

    /// The frames to train on: [`Self::samples`], or `variants` that `maker` makes of them.
    pub fn training_samples<'m, 's>(
        &'s self,
        maker: &'m FrameMaker<'s>,
        variants: Option<&Variants>,
    ) -> FrameSource<'m, 's, PreparedSample>
    where
        'c: 'm,
    {
        match variants {
            Some(variants) => FrameSource::new(self.cache, maker, variants.frames(&self.frames)),
            None => self.samples(maker),
        }
    }
}

fn placed(dataset: &Dataset) -> Result<Vec<Placed>, ParticipantError> {
    let mut unique = BTreeMap::new();
    for (digest, episode) in dataset.episode_digests().zip(dataset.episodes()) {
        let count = episode.frames.len();
        let frames = u32::try_from(count).map_err(|_| {
            let number = episode.index;
            PolicyError::Sample(format!(
                "episode {number} has {count} frames, more than an episode can have"
            ))
        })?;
        // A repeated episode counts once.
        unique
            .entry(Digest(digest))
            .or_insert((frames, episode.frames.start));
    }
    let mut first = 0;
    let placed = unique.into_iter().map(|(digest, (frames, start))| {
        let placed = Placed {
            episode: RegisteredEpisode { digest, frames },
            first,
            start,
        };
        first += u64::from(frames);
        placed
    });
    Ok(placed.collect())
}

/// All frames, with their cache names.
fn named_frames(
    dataset: &Dataset,
    file: &PolicyFile,
    cache: Option<&DiskCache>,
) -> Result<Vec<FrameRef>, ParticipantError> {
    let PolicyFile { policy, tokenizer } = file;
    let space = KeySpace::new::<PreparedSample>(policy, &FrozenPlace::default());
    let all: Vec<usize> = (0..dataset.len()).collect();
    let mut names = FrameNames::new(space, &policy.config, tokenizer, cache);
    Ok(names.frames(0, dataset, &all)?)
}

/// All frames as samples in memory, for small recordings. Samples in `cache` are not computed again.
pub fn prepare_samples(
    dataset: &Dataset,
    file: &PolicyFile,
    cache: Option<&DiskCache>,
) -> Result<Vec<PreparedSample>, ParticipantError> {
    let PolicyFile { policy, tokenizer } = file;
    let frames = named_frames(dataset, file, cache)?;
    let maker = FrameMaker::new(slice::from_ref(dataset), policy.config.chunk_size, || {
        Preparer::new(policy, tokenizer)
    });
    Ok(prepare(cache, &maker, frames)?.into_samples()?)
}
