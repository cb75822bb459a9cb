//! When a video shows its pictures, by the index of its file: nothing is decoded.

use std::fs::File;
use std::path::Path;

use crate::dataset::video::mp4::track::Mp4Track;

/// Seconds at which the pictures of a file are shown, ascending.
pub(super) struct PictureTimes(Vec<f64>);

impl PictureTimes {
    /// `None` where the file has no index that can be read: whoever asks for one of its pictures learns why.
    pub fn read(path: &Path) -> Option<Self> {
        let track = Mp4Track::read(&mut File::open(path).ok()?).ok()?;
        let time = |&sample: &u32| track.samples[sample as usize].time;
        Some(Self(track.order.iter().map(time).collect()))
    }

    /// Number of pictures in the file.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Number of pictures from second `from` on, and before second `to`, each give or take half a picture.
    pub fn between(&self, from: f64, to: f64, fps: u32) -> usize {
        let half = 0.5 / f64::from(fps);
        let before = |second: f64| self.0.partition_point(|&time| time < second - half);
        before(to).saturating_sub(before(from))
    }
}
