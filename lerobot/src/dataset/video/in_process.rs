//! Decoding by linked libraries: AV1, and most of H.264.

use std::collections::BTreeMap;

use crate::dataset::video::av1::Av1;
use crate::dataset::video::h264::decoder::H264;
use crate::dataset::video::kind::PictureKind;
use crate::dataset::video::mp4::sample::{Mp4Codec, Mp4Sample};
use crate::dataset::video::restart;
use crate::dataset::video::source::VideoSource;
use crate::dataset::DatasetError;

/// Most pictures that may be decoded before an earlier one is shown; H.264's limit.
const MAX_AHEAD: usize = 16;

pub(super) struct InProcess {
    /// Of H.264.
    kind: Option<PictureKind>,
    playing: Option<Playing>,
}

struct Playing {
    decoder: FrameDecoder,
    /// It was fed everything from a key frame to before this sample.
    next: usize,
    /// Decoded pictures not requested yet, by sample: B-frames shown earlier come later.
    ahead: BTreeMap<usize, Vec<u8>>,
}

enum FrameDecoder {
    Av1(Av1),
    H264(H264),
}

impl InProcess {
    pub fn new(kind: Option<PictureKind>) -> Self {
        Self {
            kind,
            playing: None,
        }
    }

    /// RGB of sample `sample`, number `number` in presentation, not turned.
    pub fn rgb(
        &mut self,
        source: &mut VideoSource,
        number: usize,
        sample: usize,
    ) -> Result<Vec<u8>, DatasetError> {
        let key = source.key_before(sample);
        // Taken out, so that a failed decoder is not used again.
        let mut playing = match self.playing.take() {
            Some(playing) if playing.reaches(key, sample) => playing,
            elsewhere => {
                let next = restart::before(source, key)?.key;
                // A decoder may be unable to begin with the first sample.
                let elsewhere = elsewhere.filter(|_| next > 0);
                Playing {
                    decoder: match elsewhere.and_then(|playing| playing.decoder.emptied()) {
                        Some(decoder) => decoder,
                        None => self.decoder(source)?,
                    },
                    next,
                    ahead: BTreeMap::new(),
                }
            }
        };
        let time = source.track.samples[sample].time;
        let samples = &source.track.samples;
        playing
            .ahead
            .retain(|&at, _| at == sample || samples[at].time > time);
        while playing.next <= sample {
            let at = playing.next;
            let Mp4Sample {
                key, time: shown, ..
            } = source.track.samples[at];
            let show = at == sample || shown > time;
            let encoded = source.sample(at)?;
            let picture = playing
                .decoder
                .decode(encoded, key, show)
                .map_err(|e| source.fault(at, e))?;
            playing.ahead.extend(picture.map(|rgb| (at, rgb)));
            playing.next += 1;
            if playing.ahead.len() > MAX_AHEAD + 1 {
                return Err(
                    source.fault(number, "is shown long before frames that come first".into())
                );
            }
        }
        let rgb = playing.ahead.remove(&sample).ok_or_else(|| {
            source.fault(
                number,
                "does not decode, as in a damaged file: no picture came out".into(),
            )
        })?;
        self.playing = Some(playing);
        Ok(rgb)
    }

    fn decoder(&self, source: &VideoSource) -> Result<FrameDecoder, DatasetError> {
        let track = &source.track;
        let (height, width) = (track.height, track.width);
        match (&track.codec, self.kind) {
            (Mp4Codec::Av1, _) => Av1::new(height, width).map(FrameDecoder::Av1),
            (Mp4Codec::H264(config), Some(kind)) => {
                H264::new(config, track.colors, kind, height, width).map(FrameDecoder::H264)
            }
            _ => Err("has no decoder in this program".into()),
        }
        .map_err(|e| DatasetError::video(&source.path, e))
    }
}

impl Playing {
    /// Whether to go on to `sample`, with key frame `key`, rather than restart.
    fn reaches(&self, key: usize, sample: usize) -> bool {
        self.ahead.contains_key(&sample) || (key..=sample).contains(&self.next)
    }
}

impl FrameDecoder {
    /// The decoder, emptied: cheaper than a new one. `None` where it cannot be.
    fn emptied(self) -> Option<Self> {
        match self {
            Self::Av1(decoder) => Some(Self::Av1(decoder.emptied())),
            Self::H264(decoder) => decoder.emptied().map(Self::H264),
        }
    }

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
