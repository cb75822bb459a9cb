//! Frames of one mp4 file by time: decoded once when asked for in order, from the nearest key frame otherwise.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use crate::dataset::video::av1::Av1;
use crate::dataset::video::h264::annex_b::starts_anew;
use crate::dataset::video::h264::decoder::H264;
use crate::dataset::video::mp4::sample::{Mp4Codec, Mp4Sample};
use crate::dataset::video::mp4::track::Mp4Track;
use crate::dataset::DatasetError;

/// Most pictures that may have to be decoded before an earlier one is shown; H.264 allows no more.
const MAX_AHEAD: usize = 16;

/// An open video; holds its index (about 36 bytes a frame) and one decoder, not its content.
pub struct VideoReader {
    path: PathBuf,
    file: File,
    track: Mp4Track,
    playing: Option<Playing>,
}

/// A decoder, and where it is.
struct Playing {
    decoder: FrameDecoder,
    /// It has been fed everything from some key frame up to, not including, this sample.
    next: usize,
    /// Pictures decoded and not asked for yet, by sample: B-frames that are shown before them came later.
    ahead: BTreeMap<usize, Vec<u8>>,
}

enum FrameDecoder {
    Av1(Av1),
    H264(H264),
}

impl VideoReader {
    /// Opens an mp4 whose pictures are `height x width`.
    ///
    /// # Errors
    /// Missing, cut off, not an mp4, not AV1 or H.264, or of another size; the path and what is wrong.
    pub fn open(path: &Path, height: usize, width: usize) -> Result<Self, DatasetError> {
        let mut file = File::open(path).map_err(|e| DatasetError::io(path, e))?;
        let track = Mp4Track::read(&mut file).map_err(|cause| DatasetError::video(path, cause))?;
        if (track.height, track.width) != (height, width) {
            return Err(DatasetError::video(
                path,
                format!(
                    "pictures are {} x {} (height x width), meta/info.json says {height} x {width}",
                    track.height, track.width
                ),
            ));
        }
        Ok(Self {
            path: path.into(),
            file,
            track,
            playing: None,
        })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// How its frames are encoded.
    pub fn codec(&self) -> &Mp4Codec {
        &self.track.codec
    }

    /// Number of frames.
    pub fn len(&self) -> usize {
        self.track.samples.len()
    }

    /// Number of key frames, at least 1: decoding can start at any of them.
    pub fn key_frames(&self) -> usize {
        self.track.samples.iter().filter(|s| s.key).count()
    }

    /// Whether there are no frames; [`VideoReader::open`] refuses such a file, so this is `false`.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Number of the frame shown at `seconds`, give or take `tolerance` seconds.
    ///
    /// # Errors
    /// No frame is shown at that time.
    pub fn frame_at(&self, seconds: f64, tolerance: f64) -> Result<usize, DatasetError> {
        let order = &self.track.order;
        let time = |&sample: &u32| self.track.samples[sample as usize].time;
        let after = order.partition_point(|sample| time(sample) < seconds);
        let distance = |i: &usize| order.get(*i).map(|sample| (time(sample) - seconds).abs());
        [after.saturating_sub(1), after]
            .into_iter()
            .filter(|i| distance(i).is_some_and(|d| d <= tolerance))
            .min_by(|a, b| distance(a).partial_cmp(&distance(b)).unwrap_or(std::cmp::Ordering::Equal))
            .ok_or_else(|| {
                let last = order.last().map_or(0.0, time);
                DatasetError::video(
                    &self.path,
                    format!(
                        "shows no frame at {seconds:.6} s (within {tolerance} s); its {} frames end at {last:.6} s",
                        order.len()
                    ),
                )
            })
    }

    /// RGB of frame `number` in order of presentation, `[3, height, width]`; asking in ascending order decodes every frame once.
    ///
    /// # Errors
    /// There is no such frame, or it or one it depends on does not decode.
    pub fn rgb(&mut self, number: usize) -> Result<Vec<u8>, DatasetError> {
        let Some(&sample) = self.track.order.get(number) else {
            let all = self.len();
            return Err(self.fault(number, format!("does not exist, there are {all}")));
        };
        let sample = sample as usize;
        let key = self.key_before(sample);
        // The decoder is taken out, so that a decoder that failed is not used again.
        let mut playing = match self.playing.take() {
            Some(playing) if playing.reaches(key, sample) => playing,
            _ => Playing {
                decoder: self.decoder()?,
                next: self.start_before(key)?,
                ahead: BTreeMap::new(),
            },
        };
        let samples = &self.track.samples;
        let shown_later = |at: usize| samples[at].time > samples[sample].time;
        playing
            .ahead
            .retain(|&at, _| at == sample || shown_later(at));
        while playing.next <= sample {
            let at = playing.next;
            let show = at == sample || shown_later(at);
            let encoded = read_sample(&mut self.file, &self.path, &samples[at])?;
            let picture = playing
                .decoder
                .decode(encoded, samples[at].key, show)
                .map_err(|e| self.fault(at, e))?;
            playing.ahead.extend(picture.map(|rgb| (at, rgb)));
            playing.next += 1;
            if playing.ahead.len() > MAX_AHEAD + 1 {
                return Err(
                    self.fault(number, "is shown long before frames that come first".into())
                );
            }
        }
        let rgb = playing.ahead.remove(&sample).ok_or_else(|| {
            self.fault(
                number,
                "does not decode, as in a damaged file: no picture came out".into(),
            )
        })?;
        self.playing = Some(playing);
        Ok(rgb)
    }

    fn fault(&self, frame: usize, cause: String) -> DatasetError {
        DatasetError::video(&self.path, format!("video frame {frame} {cause}"))
    }

    fn decoder(&self) -> Result<FrameDecoder, DatasetError> {
        let (height, width) = (self.track.height, self.track.width);
        match &self.track.codec {
            Mp4Codec::Av1 => Av1::new(height, width).map(FrameDecoder::Av1),
            Mp4Codec::H264(config) => H264::new(config, height, width).map(FrameDecoder::H264),
        }
        .map_err(|e| DatasetError::video(&self.path, e))
    }

    /// The last key frame up to `sample`.
    fn key_before(&self, sample: usize) -> usize {
        let upto = &self.track.samples[..=sample];
        upto.iter().rposition(|s| s.key).unwrap_or(0)
    }

    /// Where a new decoder can begin to reach the key frame `key`: frames after some of H.264's are shown before it and depend on
    /// what came earlier, so there it is the last that starts anew.
    fn start_before(&mut self, mut key: usize) -> Result<usize, DatasetError> {
        if let Mp4Codec::H264(config) = &self.track.codec {
            while key > 0 {
                let encoded = read_sample(&mut self.file, &self.path, &self.track.samples[key])?;
                if starts_anew(config, &encoded) {
                    break;
                }
                key = self.key_before(key - 1);
            }
        }
        Ok(key)
    }
}

impl Playing {
    /// Whether to go on from here to get at `sample`, whose key frame is `key`, rather than start anew.
    fn reaches(&self, key: usize, sample: usize) -> bool {
        self.ahead.contains_key(&sample) || (key..=sample).contains(&self.next)
    }
}

impl FrameDecoder {
    fn decode(
        &mut self,
        encoded: Vec<u8>,
        key: bool,
        show: bool,
    ) -> Result<Option<Vec<u8>>, String> {
        match self {
            Self::Av1(decoder) => {
                let picture = decoder.decode(encoded)?;
                show.then(|| picture.to_rgb()).transpose()
            }
            Self::H264(decoder) => decoder.decode(&encoded, key, show),
        }
    }
}

/// One encoded frame's bytes; `Mp4Track` has checked that they lie within the file.
fn read_sample(file: &mut File, path: &Path, sample: &Mp4Sample) -> Result<Vec<u8>, DatasetError> {
    let mut bytes = vec![0; sample.size as usize];
    file.seek(SeekFrom::Start(sample.offset))
        .and_then(|_| file.read_exact(&mut bytes))
        .map_err(|e| DatasetError::io(path, e))?;
    Ok(bytes)
}
