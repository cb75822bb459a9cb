//! The one way to samples of chosen frames.

use std::borrow::Cow;
use std::thread;

use zk0_lerobot::dataset::Dataset;
use zk0_lerobot::tokenizer::Tokenizer;
use zk0_lerobot::PolicyConfig;

use crate::error::Result;
use crate::frames::batch::{missing, SampleSource};
use crate::frames::making::MakesSamples;
use crate::frames::prefix_cache::entry::CacheEntry;
use crate::frames::prefix_cache::error::CacheError;
use crate::frames::prefix_cache::files::FileDigests;
use crate::frames::prefix_cache::key::FrameRef;
use crate::frames::prefix_cache::key_space::KeySpace;
use crate::frames::prefix_cache::maker::FrameMaker;
use crate::frames::prefix_cache::source::FrameSource;
use crate::frames::prefix_cache::store::DiskCache;
use crate::frames::sample::FromFrame;

/// Names frames of several recordings. The cache remembers their videos' digests.
pub struct FrameNames<'a> {
    space: KeySpace,
    config: &'a PolicyConfig,
    tokenizer: &'a dyn Tokenizer,
    cache: Option<&'a DiskCache>,
    files: FileDigests,
}

impl<'a> FrameNames<'a> {
    /// For samples of `space`, with the dimensions `config`.
    pub fn new(
        space: KeySpace,
        config: &'a PolicyConfig,
        tokenizer: &'a dyn Tokenizer,
        cache: Option<&'a DiskCache>,
    ) -> Self {
        Self {
            space,
            config,
            tokenizer,
            cache,
            files: cache.map(DiskCache::file_digests).unwrap_or_default(),
        }
    }

    /// Names the frames `indices` of `dataset`, the [`FrameMaker`]'s recording `number`.
    ///
    /// # Errors
    /// Those of [`KeySpace::keys`], or digests cannot be written.
    pub fn frames(
        &mut self,
        number: usize,
        dataset: &Dataset,
        indices: &[usize],
    ) -> std::result::Result<Vec<FrameRef>, CacheError> {
        let (config, files) = (self.config, &mut self.files);
        let keys = self
            .space
            .keys(config, self.tokenizer, dataset, indices, files)?;
        if let Some(cache) = self.cache {
            cache.remember(&mut self.files)?;
        }
        let frames = keys.into_iter().zip(indices);
        Ok(frames
            .map(|(key, index)| FrameRef {
                dataset: number,
                index: *index,
                key,
                transformed: false,
            })
            .collect())
    }
}

/// Samples of chosen frames.
pub enum PreparedFrames<'c, 'a, S> {
    /// Read from the cache one at a time.
    Cached(FrameSource<'c, 'a, S>),
    /// All in memory.
    InMemory(Vec<S>),
}

impl<'c, 'a, S: FromFrame + CacheEntry> PreparedFrames<'c, 'a, S> {
    /// Makes samples that the cache lacks. `progress` gets the frames done and their total.
    ///
    /// # Errors
    /// A frame cannot be made, or the cache cannot be written.
    pub fn prepare(
        cache: Option<&'c DiskCache>,
        maker: &'c FrameMaker<'a>,
        frames: Vec<FrameRef>,
        progress: impl FnMut(usize, usize),
    ) -> std::result::Result<Self, CacheError> {
        let Some(cache) = cache else {
            return Self::in_memory(maker, frames, progress);
        };
        let source = FrameSource::new(cache, maker, frames);
        let filled = source.fill(progress)?;
        tracing::info!(
            "the prefix cache {} has {} of the samples; {} were computed and stored; {} did not fit",
            cache.root().display(),
            filled.found,
            filled.made,
            filled.beyond
        );
        Ok(Self::Cached(source))
    }

    /// As [`Self::prepare`], but with a cache, each sample is made when asked for, or by [`ahead`](crate::frames::ahead::ahead), without
    /// `progress`.
    ///
    /// # Errors
    /// A frame cannot be made.
    pub fn while_training(
        cache: Option<&'c DiskCache>,
        maker: &'c FrameMaker<'a>,
        frames: Vec<FrameRef>,
        progress: impl FnMut(usize, usize),
    ) -> std::result::Result<Self, CacheError> {
        let Some(cache) = cache else {
            return Self::in_memory(maker, frames, progress);
        };
        let source = FrameSource::new(cache, maker, frames);
        tracing::info!(
            "the prefix cache {} has {} of {} samples; the others are computed in the background while the run trains",
            cache.root().display(),
            source.in_cache(),
            source.len()
        );
        Ok(Self::Cached(source))
    }

    /// Another thread decodes the next frame.
    fn in_memory(
        maker: &FrameMaker,
        frames: Vec<FrameRef>,
        mut progress: impl FnMut(usize, usize),
    ) -> std::result::Result<Self, CacheError> {
        let mut samples = Vec::with_capacity(frames.len());
        thread::scope(|scope| {
            let decoded = maker.decode_ahead(scope, frames.clone());
            for (frame, decoded) in frames.iter().zip(decoded) {
                samples.push(maker.sample_of(frame, decoded?)?);
                progress(samples.len(), frames.len());
            }
            Ok::<_, CacheError>(())
        })?;
        maker.rest();
        Ok(Self::InMemory(samples))
    }

    /// All samples in memory.
    ///
    /// # Errors
    /// Those of [`SampleSource::sample`].
    pub fn into_samples(self) -> Result<Vec<S>> {
        match self {
            Self::InMemory(samples) => Ok(samples),
            Self::Cached(source) => (0..source.len())
                .map(|index| Ok(source.sample(index)?.into_owned()))
                .collect(),
        }
    }
}

impl<S: FromFrame + CacheEntry> SampleSource<S> for PreparedFrames<'_, '_, S> {
    fn len(&self) -> usize {
        match self {
            Self::Cached(source) => source.len(),
            Self::InMemory(samples) => samples.len(),
        }
    }

    fn sample(&self, index: usize) -> Result<Cow<'_, S>> {
        match self {
            Self::Cached(source) => source.sample(index),
            Self::InMemory(samples) => {
                let found = samples.get(index).map(Cow::Borrowed);
                found.ok_or_else(|| missing(index, samples.len()))
            }
        }
    }

    fn rest(&self) {
        if let Self::Cached(source) = self {
            source.rest();
        }
    }

    fn makes(&self) -> Option<&dyn MakesSamples<S>> {
        match self {
            Self::Cached(source) => source.makes(),
            Self::InMemory(_) => None,
        }
    }
}
