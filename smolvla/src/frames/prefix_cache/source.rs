//! Samples of frames, from the cache or computed.

use std::borrow::Cow;
use std::marker::PhantomData;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

use crate::error::{PolicyError, Result};
use crate::frames::batch::{missing, SampleSource};
use crate::frames::making::{Begun, DecodedFrame, MakesSamples};
use crate::frames::prefix_cache::entry::CacheEntry;
use crate::frames::prefix_cache::error::CacheError;
use crate::frames::prefix_cache::key::FrameRef;
use crate::frames::prefix_cache::maker::FrameMaker;
use crate::frames::prefix_cache::store::DiskCache;
use crate::frames::recording::PrepareError;
use crate::frames::sample::FromFrame;

/// The result of [`FrameSource::fill`], in frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Filled {
    /// Already in the cache.
    pub found: usize,
    /// Computed and stored.
    pub made: usize,
    /// Not stored: computed again at each use.
    pub beyond: usize,
}

/// Frames as samples, cached or made at each use.
pub struct FrameSource<'c, 'a, S> {
    cache: Option<&'c DiskCache>,
    maker: &'c FrameMaker<'a>,
    frames: Vec<FrameRef>,
    /// All earlier frames are in the cache.
    kept: AtomicUsize,
    kind: PhantomData<fn() -> S>,
}

impl<'c, 'a, S: FromFrame + CacheEntry> FrameSource<'c, 'a, S> {
    /// For these frames, whose cache entries now stay.
    pub fn new(
        cache: impl Into<Option<&'c DiskCache>>,
        maker: &'c FrameMaker<'a>,
        frames: Vec<FrameRef>,
    ) -> Self {
        let cache = cache.into();
        if let Some(cache) = cache {
            cache.pin(frames.iter().map(|frame| frame.key));
        }
        Self {
            cache,
            maker,
            frames,
            kept: AtomicUsize::new(0),
            kind: PhantomData,
        }
    }

    /// Computes and stores what is missing, within budget and disk. `progress` gets the frames done and their total.
    ///
    /// # Errors
    /// A frame cannot be made, or the cache cannot be written.
    pub fn fill(
        &self,
        mut progress: impl FnMut(usize, usize),
    ) -> std::result::Result<Filled, CacheError> {
        let total = self.frames.len();
        let Some(cache) = self.cache else {
            (1..=total).for_each(|done| progress(done, total));
            return Ok(Filled {
                beyond: total,
                ..Filled::default()
            });
        };
        let places: Vec<usize> = (0..total)
            .filter(|place| !cache.contains(&self.frames[*place].key))
            .collect();
        let lacking = places.iter().map(|place| self.frames[*place]).collect();
        let mut places = places.into_iter().peekable();
        let mut filled = Filled::default();
        thread::scope(|scope| {
            let mut decoded = Some(self.maker.decode_ahead(scope, lacking));
            for (place, frame) in self.frames.iter().enumerate() {
                let lacks = places.next_if_eq(&place).is_some();
                match decoded.as_ref().and_then(|decoded| match lacks {
                    true => decoded.recv().ok(),
                    false => None,
                }) {
                    Some(next) => {
                        let sample = self.maker.sample_of::<S>(frame, next?)?;
                        match cache.put(&frame.key, &sample)? {
                            true => filled.made += 1,
                            false => {
                                filled.beyond += 1;
                                // Stops decoding.
                                decoded = None;
                            }
                        }
                    }
                    None if lacks => filled.beyond += 1,
                    None => filled.found += 1,
                }
                progress(place + 1, total);
            }
            Ok::<_, CacheError>(())
        })?;
        if filled.beyond == 0 {
            self.maker.rest();
        }
        Ok(filled)
    }

    /// How many frames are in the cache.
    pub fn in_cache(&self) -> usize {
        let cached = |frame: &&FrameRef| self.cache.is_some_and(|c| c.contains(&frame.key));
        self.frames.iter().filter(cached).count()
    }

    fn get(&self, frame: &FrameRef) -> std::result::Result<Begun<S>, CacheError> {
        if let Some(cache) = self.cache {
            if let Some(sample) = cache.get(&frame.key)? {
                return Ok(Begun::Whole(sample));
            }
        }
        let decoded = self.maker.decode(frame)?;
        Ok(Begun::Decoded(Box::new(decoded)))
    }

    fn make(&self, frame: &FrameRef, decoded: DecodedFrame) -> std::result::Result<S, CacheError> {
        let sample = self.maker.sample_of(frame, decoded)?;
        let Some(cache) = self.cache else {
            return Ok(sample);
        };
        if cache.put(&frame.key, &sample)? {
            self.rest_when_all_are_kept(cache);
        }
        Ok(sample)
    }

    /// The frozen half takes gigabytes.
    fn rest_when_all_are_kept(&self, cache: &DiskCache) {
        let before = self.kept.load(Ordering::Relaxed);
        let more = self.frames[before..]
            .iter()
            .take_while(|frame| cache.contains(&frame.key));
        let kept = before + more.count();
        self.kept.fetch_max(kept, Ordering::Relaxed);
        if kept == self.frames.len() {
            self.maker.rest();
        }
    }

    fn frame(&self, index: usize) -> Result<&FrameRef> {
        let frame = self.frames.get(index);
        frame.ok_or_else(|| missing(index, self.frames.len()))
    }
}

fn named(frame: &FrameRef) -> impl Fn(CacheError) -> PolicyError + '_ {
    move |error| match error {
        CacheError::Prepare(PrepareError::Dataset(error)) => PolicyError::Recording {
            frame: frame.index,
            recording: frame.dataset,
            error: Box::new(error),
        },
        error => PolicyError::Sample(format!(
            "frame {} of recording {}: {error}",
            frame.index, frame.dataset
        )),
    }
}

impl<S: FromFrame + CacheEntry> MakesSamples<S> for FrameSource<'_, '_, S> {
    fn begin(&self, index: usize) -> Result<Begun<S>> {
        let frame = self.frame(index)?;
        self.get(frame).map_err(named(frame))
    }

    fn finish(&self, index: usize, begun: Begun<S>) -> Result<S> {
        match begun {
            Begun::Whole(sample) => Ok(sample),
            Begun::Decoded(decoded) => {
                let frame = self.frame(index)?;
                self.make(frame, *decoded).map_err(named(frame))
            }
        }
    }

    fn finished_by_asker(&self) -> bool {
        self.maker.prefixes_by_asker()
    }
}

impl<S: FromFrame + CacheEntry> SampleSource<S> for FrameSource<'_, '_, S> {
    fn len(&self) -> usize {
        self.frames.len()
    }

    fn sample(&self, index: usize) -> Result<Cow<'_, S>> {
        Ok(Cow::Owned(self.finish(index, self.begin(index)?)?))
    }

    fn rest(&self) {
        self.maker.rest();
    }

    fn makes(&self) -> Option<&dyn MakesSamples<S>> {
        Some(self)
    }
}
