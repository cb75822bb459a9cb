//! The key frame where a new decoder can begin.

use std::collections::BTreeSet;

use crate::dataset::video::h264::units::starts_anew;
use crate::dataset::video::hevc::units::{dependence, Dependence};
use crate::dataset::video::mp4::sample::Mp4Codec;
use crate::dataset::video::source::VideoSource;
use crate::dataset::DatasetError;

/// A key frame, and later samples that do not decode from it.
pub(super) struct Restart {
    pub key: usize,
    pub skipped: BTreeSet<usize>,
}

/// The last key frame that `sample` can be decoded from, if any.
pub(super) fn before(source: &mut VideoSource, sample: usize) -> Result<Restart, DatasetError> {
    let mut key = source.key_before(sample);
    let mut skipped = BTreeSet::new();
    match source.track.codec.clone() {
        Mp4Codec::Av1 => {}
        // Frames after some key frames are shown earlier and depend on what came before.
        Mp4Codec::H264(config) => {
            while key > 0 && !starts_anew(&config, &source.sample(key)?) {
                key = source.key_before(key - 1);
            }
        }
        // Here, such frames are marked.
        Mp4Codec::Hevc(config) => {
            let wanted = source.track.samples[sample].time;
            while key > 0 {
                match dependence(&config, &source.sample(key)?) {
                    Dependence::Idr => break,
                    Dependence::OpenKey if wanted >= source.track.samples[key].time => break,
                    _ => key = source.key_before(key - 1),
                }
            }
            let samples = source.track.samples[key + 1..].iter();
            let shown = source.track.samples[key].time;
            let leading = samples.take_while(|s| s.time < shown).count();
            for at in key + 1..=key + leading {
                if dependence(&config, &source.sample(at)?) == Dependence::SkippedLeading {
                    skipped.insert(at);
                }
            }
        }
    }
    Ok(Restart { key, skipped })
}
