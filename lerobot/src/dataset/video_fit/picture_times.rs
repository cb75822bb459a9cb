//! When a video shows its pictures, by its index, without decoding.

use std::fs::File;
use std::path::Path;

use crate::dataset::video::mp4::track::Mp4Track;

/// Ascending seconds of a file's pictures.
pub(super) struct PictureTimes(Vec<f64>);

impl PictureTimes {
    /// `None` without a readable index: reading its pictures tells why.
    pub fn read(path: &Path) -> Option<Self> {
        let track = Mp4Track::read(&mut File::open(path).ok()?).ok()?;
        let time = |&sample: &u32| track.samples[sample as usize].time;
        Some(Self(track.order.iter().map(time).collect()))
    }

    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Pictures from second `from` on and before `to`, each ± half a picture.
    pub fn between(&self, from: f64, to: f64, fps: u32) -> usize {
        let half = 0.5 / f64::from(fps);
        let before = |second: f64| self.0.partition_point(|&time| time < second - half);
        before(to).saturating_sub(before(from))
    }
}
