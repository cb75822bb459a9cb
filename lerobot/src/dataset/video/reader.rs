//! Frames of an mp4 by time: in order, each is decoded once; else from the nearest key frame.

use std::path::Path;

use crate::dataset::video::by_ffmpeg::ByFfmpeg;
use crate::dataset::video::in_process::InProcess;
use crate::dataset::video::mp4::sample::Mp4Codec;
use crate::dataset::video::source::VideoSource;
use crate::dataset::DatasetError;

/// An open video with its index (about 36 bytes a frame) and one decoder, without its content.
pub struct VideoReader {
    source: VideoSource,
    /// Chosen at the first frame.
    decoding: Option<Decoding>,
}

enum Decoding {
    InProcess(InProcess),
    ByFfmpeg(ByFfmpeg),
}

impl VideoReader {
    /// Opens an mp4 whose shown pictures are `height x width`.
    ///
    /// # Errors
    /// The file is missing, cut, not an mp4, not AV1, H.264 or HEVC, or of another size.
    pub fn open(path: &Path, height: usize, width: usize) -> Result<Self, DatasetError> {
        Ok(Self {
            source: VideoSource::open(path, height, width)?,
            decoding: None,
        })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.source.path
    }

    /// Codec of its frames.
    pub fn codec(&self) -> &Mp4Codec {
        &self.source.track.codec
    }

    /// Number of frames.
    pub fn len(&self) -> usize {
        self.source.track.samples.len()
    }

    /// Key frames, where decoding can start; at least 1.
    pub fn key_frames(&self) -> usize {
        let samples = self.source.track.samples.iter();
        samples.filter(|s| s.key).count()
    }

    /// Always `false`: [`VideoReader::open`] refuses a file without frames.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Number of the frame shown at `seconds` ± `tolerance` seconds.
    ///
    /// # Errors
    /// No frame is shown then.
    pub fn frame_at(&self, seconds: f64, tolerance: f64) -> Result<usize, DatasetError> {
        let order = &self.source.track.order;
        let time = |&sample: &u32| self.source.track.samples[sample as usize].time;
        let after = order.partition_point(|sample| time(sample) < seconds);
        let distance = |i: &usize| order.get(*i).map(|sample| (time(sample) - seconds).abs());
        [after.saturating_sub(1), after]
            .into_iter()
            .filter(|i| distance(i).is_some_and(|d| d <= tolerance))
            .min_by(|a, b| distance(a).partial_cmp(&distance(b)).unwrap_or(std::cmp::Ordering::Equal))
            .ok_or_else(|| {
                let last = order.last().map_or(0.0, time);
                DatasetError::video(
                    &self.source.path,
                    format!(
                        "shows no frame at {seconds:.6} s (within {tolerance} s); its {} frames end at {last:.6} s",
                        order.len()
                    ),
                )
            })
    }

    /// RGB of frame `number` in presentation, `[3, height, width]`. Ascending order decodes every frame once.
    ///
    /// # Errors
    /// There is no such frame, it or one it needs does not decode, or it needs an FFmpeg that is not installed.
    pub fn rgb(&mut self, number: usize) -> Result<Vec<u8>, DatasetError> {
        let source = &mut self.source;
        let Some(&sample) = source.track.order.get(number) else {
            let all = self.len();
            return Err(self
                .source
                .fault(number, format!("does not exist, there are {all}")));
        };
        let decoding = match &mut self.decoding {
            Some(decoding) => decoding,
            None => self.decoding.insert(match source.kind()? {
                Some(kind) if !kind.openh264 => Decoding::ByFfmpeg(ByFfmpeg::new(kind)),
                kind => Decoding::InProcess(InProcess::new(kind)),
            }),
        };
        let rgb = match decoding {
            Decoding::InProcess(decoding) => decoding.rgb(source, number, sample as usize),
            Decoding::ByFfmpeg(decoding) => decoding.rgb(source, number, sample as usize),
        }?;
        let track = &source.track;
        Ok(track.turn.apply(rgb, track.height, track.width))
    }
}
