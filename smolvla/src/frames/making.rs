//! Makes samples in two parts, possibly on two threads.

use zk0_lerobot::dataset::Frame;

use crate::error::Result;
use crate::frames::image_transforms::picture::Picture;

/// Numbers of the next samples, in order.
pub type Coming = Box<dyn Iterator<Item = usize> + Send>;

/// A decoded frame.
pub struct DecodedFrame {
    /// The recorded frame.
    pub frame: Frame,
    /// Its transformed pictures, one a camera, if any.
    pub pictures: Option<Vec<Picture>>,
}

/// A sample, or a frame to make it from.
pub enum Begun<S> {
    /// A finished sample.
    Whole(S),
    /// A decoded frame for the policy's frozen half.
    Decoded(Box<DecodedFrame>),
}

/// Makes samples on any thread.
pub trait MakesSamples<S>: Sync {
    /// The first part of sample `index`.
    ///
    /// # Errors
    /// The sample cannot be made.
    fn begin(&self, index: usize) -> Result<Begun<S>>;

    /// The second part.
    ///
    /// # Errors
    /// The sample cannot be made.
    fn finish(&self, index: usize, begun: Begun<S>) -> Result<S>;

    /// Whether only the thread that asks may [finish](Self::finish) samples.
    fn finished_by_asker(&self) -> bool;
}
