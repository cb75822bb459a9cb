//! Making samples in two parts, which may run on two threads.

use zk0_lerobot::dataset::Frame;

use crate::error::Result;
use crate::frames::image_transforms::picture::Picture;

/// The numbers of the samples that are asked for next, in order.
pub type Coming = Box<dyn Iterator<Item = usize> + Send>;

/// A frame that is read.
pub struct DecodedFrame {
    /// The frame as it was recorded.
    pub frame: Frame,
    /// Its pictures transformed, camera after camera, if they are.
    pub pictures: Option<Vec<Picture>>,
}

/// A sample that is there, or a frame to make it of.
pub enum Begun<S> {
    /// It was at hand.
    Whole(S),
    /// The frame is decoded, and the frozen half of the policy has to run over it.
    Decoded(Box<DecodedFrame>),
}

/// What makes samples, on whatever thread.
pub trait MakesSamples<S>: Sync {
    /// The first part of making sample `index`.
    ///
    /// # Errors
    /// The sample cannot be had, and why.
    fn begin(&self, index: usize) -> Result<Begun<S>>;

    /// The rest of it.
    ///
    /// # Errors
    /// The sample cannot be had, and why.
    fn finish(&self, index: usize, begun: Begun<S>) -> Result<S>;

    /// Whether only the thread that asks for samples may [finish](Self::finish) them.
    fn finished_by_asker(&self) -> bool;
}
