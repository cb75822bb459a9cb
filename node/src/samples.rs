//! Frames of recordings as samples for training and evaluation: read through the prefix cache, or held in memory.

use crate::progress::Progress;
use std::borrow::Cow;
use zk0_lerobot::dataset::Dataset;
use zk0_lerobot::tokenizer::Tokenizer;
use zk0_smolvla::frames::batch::SampleSource;
use zk0_smolvla::frames::prefix_cache::entry::Entry;
use zk0_smolvla::frames::prefix_cache::{
    CacheError, DiskCache, FileDigests, FrameMaker, FrameRef, FrameSource, KeySpace,
};
use zk0_smolvla::frames::sample::{FromFrame, ObservedSample, PreparedSample};
use zk0_smolvla::train::Samples;
use zk0_smolvla::{PolicyConfig, PolicyError};

/// A kind of samples. The kind decides what is trained on them.
pub trait SampleKind: FromFrame + Entry {
    /// Samples of this kind, as training takes them.
    fn samples(source: &dyn SampleSource<Self>) -> Samples<'_>;
}

impl SampleKind for PreparedSample {
    fn samples(source: &dyn SampleSource<Self>) -> Samples<'_> {
        Samples::Prepared(source)
    }
}

impl SampleKind for ObservedSample {
    fn samples(source: &dyn SampleSource<Self>) -> Samples<'_> {
        Samples::Observed(source)
    }
}

/// Gives frames the names under which the cache keeps them.
pub struct FrameNames<'a> {
    space: KeySpace,
    config: &'a PolicyConfig,
    tokenizer: &'a dyn Tokenizer,
    cache: Option<&'a DiskCache>,
    files: FileDigests,
}

impl<'a> FrameNames<'a> {
    /// Names in `space`. The cache remembers the digests of the recordings' videos, so that they are not computed again.
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

    /// The frames `indices` of `dataset`, which is the recording of that `number` among those of a run.
    pub fn frames(
        &mut self,
        number: usize,
        dataset: &Dataset,
        indices: &[usize],
    ) -> Result<Vec<FrameRef>, CacheError> {
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
            })
            .collect())
    }
}

/// Samples that are ready for use.
pub enum ReadySamples<'c, 'a, S> {
    /// The cache has them, and they are read one at a time.
    Cached(FrameSource<'c, 'a, S>),
    /// All of them are in memory.
    InMemory(Vec<S>),
}

impl<'c, 'a, S: SampleKind> ReadySamples<'c, 'a, S> {
    /// Makes the samples that `cache` lacks; all of them where there is no cache.
    pub fn prepare(
        cache: Option<&'c DiskCache>,
        maker: &'c FrameMaker<'a>,
        frames: Vec<FrameRef>,
    ) -> Result<Self, CacheError> {
        let mut progress = Progress::start("preparing samples", frames.len() as u64);
        let Some(cache) = cache else {
            let mut samples = Vec::with_capacity(frames.len());
            for frame in &frames {
                samples.push(maker.make(frame)?);
                progress.reached(samples.len() as u64);
            }
            maker.rest();
            return Ok(Self::InMemory(samples));
        };
        let source = FrameSource::new(cache, maker, frames);
        let filled = source.fill(|done, _| progress.reached(done as u64))?;
        tracing::info!(
            "the prefix cache {} has {} of the samples; {} were computed and stored",
            cache.root().display(),
            filled.found,
            filled.made
        );
        if filled.beyond > 0 {
            tracing::warn!(
                "{} samples do not fit into the prefix cache, so they are computed whenever they are needed; a larger cache \
                 (--cache-budget) is faster",
                filled.beyond
            );
        }
        Ok(Self::Cached(source))
    }
}

impl<S: SampleKind> SampleSource<S> for ReadySamples<'_, '_, S> {
    fn len(&self) -> usize {
        match self {
            Self::Cached(source) => source.len(),
            Self::InMemory(samples) => samples.len(),
        }
    }

    fn sample(&self, index: usize) -> Result<Cow<'_, S>, PolicyError> {
        match self {
            Self::Cached(source) => source.sample(index),
            Self::InMemory(samples) => match samples.get(index) {
                Some(sample) => Ok(Cow::Borrowed(sample)),
                None => Err(PolicyError::Sample(format!(
                    "there is no sample {index} among {}",
                    samples.len()
                ))),
            },
        }
    }
}
