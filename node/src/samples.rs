//! Frames as samples for training and evaluation, with progress on the terminal.

use crate::progress::Progress;
use zk0_smolvla::frames::batch::SampleSource;
use zk0_smolvla::frames::prefix_cache::entry::CacheEntry;
use zk0_smolvla::frames::prefix_cache::{
    CacheError, DiskCache, FrameMaker, FrameRef, PreparedFrames,
};
use zk0_smolvla::frames::sample::{FromFrame, ObservedSample, PreparedSample};
use zk0_smolvla::train::TrainingSamples;

/// A kind of samples, which decides what is trained.
pub trait SampleKind: FromFrame + CacheEntry {
    /// Samples of this kind, as training takes them.
    fn samples(source: &dyn SampleSource<Self>) -> TrainingSamples<'_>;
}

impl SampleKind for PreparedSample {
    fn samples(source: &dyn SampleSource<Self>) -> TrainingSamples<'_> {
        TrainingSamples::Prepared(source)
    }
}

impl SampleKind for ObservedSample {
    fn samples(source: &dyn SampleSource<Self>) -> TrainingSamples<'_> {
        TrainingSamples::Observed(source)
    }
}

/// Samples for training. Those that `cache` lacks are made during the run; without a cache, all are made now.
pub fn while_training<'c, 'a, S: FromFrame + CacheEntry>(
    cache: Option<&'c DiskCache>,
    maker: &'c FrameMaker<'a>,
    frames: Vec<FrameRef>,
) -> Result<PreparedFrames<'c, 'a, S>, CacheError> {
    let mut progress = Progress::start("preparing samples", frames.len() as u64);
    PreparedFrames::while_training(cache, maker, frames, |done, _| {
        progress.reached(done as u64)
    })
}

/// Makes the samples that `cache` lacks, or all without a cache.
pub fn prepare<'c, 'a, S: FromFrame + CacheEntry>(
    cache: Option<&'c DiskCache>,
    maker: &'c FrameMaker<'a>,
    frames: Vec<FrameRef>,
) -> Result<PreparedFrames<'c, 'a, S>, CacheError> {
    let mut progress = Progress::start("preparing samples", frames.len() as u64);
    PreparedFrames::prepare(cache, maker, frames, |done, _| {
        progress.reached(done as u64)
    })
}
