//! Makes samples of frames: decoding, then the policy's frozen half.

use std::sync::mpsc::{sync_channel, Receiver};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread::Scope;

use zk0_lerobot::dataset::{Dataset, Loader};

use crate::error::{PolicyError, Result};
use crate::frames::batch::missing;
use crate::frames::image_transforms::variants::Variants;
use crate::frames::making::DecodedFrame;
use crate::frames::prefix_cache::key::FrameRef;
use crate::frames::recording::PrepareError;
use crate::frames::sample::{FromFrame, Preparer};

type Load<'a> = dyn Fn() -> Result<Preparer<'a>> + Send + Sync + 'a;

/// Makes samples of frames. The policy's frozen half is loaded for the first.
///
/// Threads may share it. Each part does one frame at a time.
pub struct FrameMaker<'a> {
    datasets: &'a [Dataset],
    chunk: usize,
    load: Box<Load<'a>>,
    by_asker: bool,
    variants: Option<Variants>,
    preparer: Mutex<Option<Preparer<'a>>>,
    loaders: Mutex<Vec<Option<Loader<'a>>>>,
}

impl<'a> FrameMaker<'a> {
    /// For `datasets`, with action chunks of `chunk`; `load` gives the policy's frozen half.
    pub fn new(
        datasets: &'a [Dataset],
        chunk: usize,
        load: impl Fn() -> Result<Preparer<'a>> + Send + Sync + 'a,
    ) -> Self {
        Self {
            datasets,
            chunk,
            load: Box::new(load),
            by_asker: false,
            variants: None,
            preparer: Mutex::new(None),
            loaders: Mutex::new(datasets.iter().map(|_| None).collect()),
        }
    }

    /// Whether only the thread that asks for a sample runs the frozen half, because training keeps the GPU busy.
    pub fn with_prefixes_by_asker(self, by_asker: bool) -> Self {
        Self { by_asker, ..self }
    }

    /// Transforms only the frames from [`Variants::frames`].
    pub fn with_variants(self, variants: Option<Variants>) -> Self {
        Self { variants, ..self }
    }

    pub(super) fn prefixes_by_asker(&self) -> bool {
        self.by_asker
    }

    /// A frame's sample.
    ///
    /// # Errors
    /// The recording or the policy is at fault.
    pub fn make<S: FromFrame>(&self, frame: &FrameRef) -> std::result::Result<S, PrepareError> {
        self.sample_of(frame, self.decode(frame)?)
    }

    /// The first part: reads a frame, and transforms variants.
    ///
    /// # Errors
    /// The recording is at fault.
    pub fn decode(&self, frame: &FrameRef) -> std::result::Result<DecodedFrame, PrepareError> {
        let dataset = self.dataset(frame)?;
        let mut loaders = locked(&self.loaders);
        let loader = match &mut loaders[frame.dataset] {
            Some(loader) => loader,
            none => none.insert(dataset.loader(self.chunk)?),
        };
        let decoded = loader.frame(frame.index)?;
        drop(loaders);
        let pictures = match (frame.transformed, &self.variants) {
            (false, _) => None,
            (true, Some(variants)) => Some(variants.pictures(&frame.key, &decoded.images)),
            (true, None) => {
                let why =
                    "a transformed frame is asked for, and nothing states how to transform it";
                return Err(PolicyError::Sample(why.into()).into());
            }
        };
        Ok(DecodedFrame {
            frame: decoded,
            pictures,
        })
    }

    /// The second part.
    ///
    /// # Errors
    /// The frame does not fit the policy, or the policy cannot be loaded.
    pub fn sample_of<S: FromFrame>(
        &self,
        frame: &FrameRef,
        decoded: DecodedFrame,
    ) -> std::result::Result<S, PrepareError> {
        let dataset = self.dataset(frame)?;
        let mut preparer = locked(&self.preparer);
        let preparer = match &mut *preparer {
            Some(preparer) => preparer,
            none => none.insert((self.load)()?),
        };
        Ok(preparer.prepare_decoded(dataset, decoded)?)
    }

    /// Decodes `frames` in order, at most two ahead, until the receiver is dropped.
    pub(super) fn decode_ahead<'scope, 'env>(
        &'env self,
        scope: &'scope Scope<'scope, 'env>,
        frames: Vec<FrameRef>,
    ) -> Receiver<std::result::Result<DecodedFrame, PrepareError>> {
        let (sender, receiver) = sync_channel(1);
        scope.spawn(move || {
            for frame in frames {
                if sender.send(self.decode(&frame)).is_err() {
                    return;
                }
            }
        });
        receiver
    }

    /// Frees the frozen half and the decoders.
    pub fn rest(&self) {
        *locked(&self.preparer) = None;
        locked(&self.loaders)
            .iter_mut()
            .for_each(|loader| *loader = None);
    }

    fn dataset(&self, frame: &FrameRef) -> Result<&'a Dataset> {
        let found = self.datasets.get(frame.dataset);
        found.ok_or_else(|| missing(frame.dataset, self.datasets.len()))
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
