//! Frames of recordings as samples: from the cache where they are in it, computed where not.

use std::borrow::Cow;
use std::cell::RefCell;
use std::marker::PhantomData;

use zk0_lerobot::dataset::{Dataset, Loader};

use crate::error::{PolicyError, Result};
use crate::frames::batch::{missing, SampleSource};
use crate::frames::prefix_cache::entry::Entry;
use crate::frames::prefix_cache::error::CacheError;
use crate::frames::prefix_cache::key::Key;
use crate::frames::prefix_cache::store::DiskCache;
use crate::frames::recording::PrepareError;
use crate::frames::sample::{FromFrame, Preparer};

/// A frame of one of several recordings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameRef {
    /// Which recording.
    pub dataset: usize,
    /// Which of its frames.
    pub index: usize,
    /// The frame's name in the cache.
    pub key: Key,
}

/// Makes samples of frames. The frozen half of the policy is loaded when the first has to be made.
pub struct FrameMaker<'a> {
    datasets: &'a [Dataset],
    chunk: usize,
    load: Box<dyn Fn() -> Result<Preparer<'a>> + 'a>,
    preparer: RefCell<Option<Preparer<'a>>>,
    loaders: RefCell<Vec<Option<Loader<'a>>>>,
}

impl<'a> FrameMaker<'a> {
    /// Of frames of `datasets`, with action chunks of `chunk`; `load` gives the policy's frozen half.
    pub fn new(
        datasets: &'a [Dataset],
        chunk: usize,
        load: impl Fn() -> Result<Preparer<'a>> + 'a,
    ) -> Self {
        Self {
            datasets,
            chunk,
            load: Box::new(load),
            preparer: RefCell::new(None),
            loaders: RefCell::new(datasets.iter().map(|_| None).collect()),
        }
    }

    /// The sample of a frame.
    ///
    /// # Errors
    /// The recording or the policy is at fault.
    pub fn make<S: FromFrame>(&self, frame: &FrameRef) -> std::result::Result<S, PrepareError> {
        let mut preparer = self.preparer.borrow_mut();
        let preparer = match &mut *preparer {
            Some(preparer) => preparer,
            none => none.insert((self.load)()?),
        };
        let Some(dataset) = self.datasets.get(frame.dataset) else {
            return Err(missing(frame.dataset, self.datasets.len()).into());
        };
        let mut loaders = self.loaders.borrow_mut();
        let loader = match &mut loaders[frame.dataset] {
            Some(loader) => loader,
            none => none.insert(dataset.loader(self.chunk)?),
        };
        preparer.prepare_frame(dataset, loader, frame.index)
    }

    /// Frees the frozen half and the decoders until they are needed again.
    pub fn rest(&self) {
        *self.preparer.borrow_mut() = None;
        self.loaders
            .borrow_mut()
            .iter_mut()
            .for_each(|loader| *loader = None);
    }
}

/// What [`FrameSource::fill`] found and did, in frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Filled {
    /// In the cache already.
    pub found: usize,
    /// Computed and stored.
    pub made: usize,
    /// Beyond the budget: computed again whenever they are needed.
    pub beyond: usize,
}

/// Some frames as samples: through the cache, or each made whenever it is needed.
pub struct FrameSource<'c, 'a, S> {
    cache: Option<&'c DiskCache>,
    maker: &'c FrameMaker<'a>,
    frames: Vec<FrameRef>,
    kind: PhantomData<S>,
}

impl<'c, 'a, S: FromFrame + Entry> FrameSource<'c, 'a, S> {
    /// Of these frames, whose entries stay in the cache from now on, if there is one.
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
            kind: PhantomData,
        }
    }

    /// Computes and stores what is missing, as far as the budget goes. `progress` is called with the frames done and their
    /// total.
    ///
    /// # Errors
    /// A frame cannot be made, or the cache not be written.
    pub fn fill(
        &self,
        mut progress: impl FnMut(usize, usize),
    ) -> std::result::Result<Filled, CacheError> {
        let mut filled = Filled::default();
        for (done, frame) in self.frames.iter().enumerate() {
            match self.cache {
                Some(cache) if cache.contains(&frame.key) => filled.found += 1,
                Some(cache) if filled.beyond == 0 => {
                    match cache.put(&frame.key, &self.maker.make::<S>(frame)?)? {
                        true => filled.made += 1,
                        false => filled.beyond += 1,
                    }
                }
                _ => filled.beyond += 1,
            }
            progress(done + 1, self.frames.len());
        }
        if filled.beyond == 0 {
            self.maker.rest();
        }
        Ok(filled)
    }

    fn get(&self, frame: &FrameRef) -> std::result::Result<S, CacheError> {
        let Some(cache) = self.cache else {
            return Ok(self.maker.make(frame)?);
        };
        if let Some(sample) = cache.get(&frame.key)? {
            return Ok(sample);
        }
        let sample = self.maker.make(frame)?;
        cache.put(&frame.key, &sample)?;
        Ok(sample)
    }
}

impl<S: FromFrame + Entry> SampleSource<S> for FrameSource<'_, '_, S> {
    fn len(&self) -> usize {
        self.frames.len()
    }

    fn sample(&self, index: usize) -> Result<Cow<'_, S>> {
        let frame = self.frames.get(index);
        let frame = frame.ok_or_else(|| missing(index, self.frames.len()))?;
        let sample = self.get(frame).map_err(|error| {
            PolicyError::Sample(format!(
                "frame {} of recording {}: {error}",
                frame.index, frame.dataset
            ))
        })?;
        Ok(Cow::Owned(sample))
    }

    fn rest(&self) {
        self.maker.rest();
    }
}
