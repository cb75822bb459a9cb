//! Decoding by an installed FFmpeg: HEVC, and H.264 that OpenH264 does not support.

use std::borrow::Cow;

use crate::dataset::video::color::{rgb_from_yuv, Yuv, YuvFormat};
use crate::dataset::video::ffmpeg::player::Player;
use crate::dataset::video::h264::sps as h264_sps;
use crate::dataset::video::h264::units as h264;
use crate::dataset::video::hevc::sps as hevc_sps;
use crate::dataset::video::hevc::units as hevc;
use crate::dataset::video::kind::PictureKind;
use crate::dataset::video::mp4::sample::{ContainerColors, Mp4Codec};
use crate::dataset::video::nal::{self, Units};
use crate::dataset::video::picture_order::{PictureOrder, PicturePosition};
use crate::dataset::video::restart;
use crate::dataset::video::source::VideoSource;
use crate::dataset::DatasetError;

/// FFmpeg's start takes as long as about so many small pictures.
const WORTH_A_START: usize = 60;

pub(super) struct ByFfmpeg {
    kind: PictureKind,
    player: Option<(Player, PictureOrder)>,
}

impl ByFfmpeg {
    pub fn new(kind: PictureKind) -> Self {
        Self { kind, player: None }
    }

    /// RGB of sample `sample`, number `number` in presentation, not turned.
    pub fn rgb(
        &mut self,
        source: &mut VideoSource,
        number: usize,
        sample: usize,
    ) -> Result<Vec<u8>, DatasetError> {
        // Taken out, so that a failed player is not used again.
        let (mut player, mut order) = match self.player.take() {
            Some((player, order)) if near(&player, number) => (player, order),
            _ => self.start(source, number, sample)?,
        };
        let planes = player
            .picture(number, |at, sets| self.stream(source, at, sets, &mut order))
            .map_err(|e| source.fault(number, e))?;
        let rgb = rgb(
            &planes,
            self.kind.format,
            source.track.height,
            source.track.width,
        );
        self.player = Some((player, order));
        rgb.ok_or_else(|| source.fault(number, "has planes smaller than its size".into()))
    }

    /// FFmpeg at the last key frame that `sample` can be decoded from.
    fn start(
        &self,
        source: &mut VideoSource,
        number: usize,
        sample: usize,
    ) -> Result<(Player, PictureOrder), DatasetError> {
        let restart = restart::before(source, sample)?;
        let track = &source.track;
        let (demuxer, order) = match &track.codec {
            Mp4Codec::Hevc(_) => ("hevc", PictureOrder::Hevc(Default::default())),
            _ => ("h264", PictureOrder::H264(Default::default())),
        };
        let bytes = sizes(self.kind.format, track.height, track.width);
        let player = Player::start(demuxer, bytes.iter().sum(), &track.order, restart)
            .map_err(|e| source.fault(number, e))?;
        Ok((player, order))
    }

    /// A sample's byte stream and its picture's place in it. Its parameter sets must declare what the first one did.
    fn stream(
        &self,
        source: &mut VideoSource,
        at: usize,
        sets: bool,
        order: &mut PictureOrder,
    ) -> Result<(Vec<u8>, Option<PicturePosition>), String> {
        let sample = source.sample(at).map_err(|e| e.to_string())?;
        let track = &source.track;
        let (height, width) = (track.height, track.width);
        let stream = match &track.codec {
            Mp4Codec::Hevc(config) => nal::stream(config, &sample, sets, |unit| {
                if !hevc::is_base_layer(unit) {
                    return Err("has several layers (as in MV-HEVC), which is not read".into());
                }
                if hevc::is_sequence_parameters(unit) {
                    hevc_sps::kind(unit, height, width)?.same_as(self.kind)?;
                }
                Ok(Cow::Borrowed(unit))
            }),
            Mp4Codec::H264(config) => nal::stream(config, &sample, sets, |unit| {
                checked_h264(unit, height, width, track.colors, self.kind)
            }),
            Mp4Codec::Av1 => Err("is not decoded by FFmpeg".into()),
        };
        let stream = stream.map_err(|e| format!("does not decode: sample {at} {e}"))?;
        // Without its picture, later pictures would be taken for one frame earlier.
        let whole = match &track.codec {
            Mp4Codec::Hevc(config) => hevc::pictures(config, &sample) == 1,
            Mp4Codec::H264(config) => h264::has_picture(config, &sample),
            Mp4Codec::Av1 => false,
        };
        if !whole {
            return Err(format!(
                "does not decode: sample {at} does not hold one picture"
            ));
        }
        let place = match &track.codec {
            Mp4Codec::Hevc(config) | Mp4Codec::H264(config) => {
                let sets = config.parameter_sets.iter().filter(|_| sets);
                let units = Units::new(config, &sample).map_while(Result::ok);
                sets.map(Vec::as_slice)
                    .chain(units)
                    .find_map(|unit| order.see(unit))
            }
            Mp4Codec::Av1 => None,
        };
        Ok((stream, place))
    }
}

fn checked_h264(
    unit: &[u8],
    height: usize,
    width: usize,
    colors: ContainerColors,
    kind: PictureKind,
) -> Result<Cow<'_, [u8]>, String> {
    if h264::is_sequence_parameters(unit) {
        h264_sps::kind(unit, height, width, colors)?.same_as(kind)?;
    }
    Ok(unit.into())
}

/// Whether playing on is quicker than a restart.
fn near(player: &Player, number: usize) -> bool {
    let next = player.next_number();
    (next..next + WORTH_A_START).contains(&number)
}

fn sizes(format: YuvFormat, height: usize, width: usize) -> [usize; 3] {
    let (rows, columns) = format.chroma_size(height, width);
    [height * width, rows * columns, rows * columns].map(|samples| samples * format.sample_bytes())
}

fn rgb(planes: &[u8], format: YuvFormat, height: usize, width: usize) -> Option<Vec<u8>> {
    let [luma, chroma, _] = sizes(format, height, width);
    let (_, columns) = format.chroma_size(height, width);
    let (y, rest) = planes.split_at_checked(luma)?;
    let (u, v) = rest.split_at_checked(chroma)?;
    rgb_from_yuv(&Yuv {
        format,
        y,
        u,
        v,
        y_stride: width * format.sample_bytes(),
        uv_stride: columns * format.sample_bytes(),
        height,
        width,
    })
}
