//! Pictures that LeRobot had not encoded yet, as H.264 in an mp4, by OpenH264, which zk0 has for reading. Every second picture is a key
//! frame, as in LeRobot's videos.

use std::fs::File;
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use openh264::encoder::{
    BitRate, Encoder, EncoderConfig, FrameRate, IntraFramePeriod, Profile, QpRange, RateControlMode,
};
use openh264::formats::YUVSlices;
use openh264::OpenH264API;
use zk0_files::bounded_file;

use crate::dataset::metadata::info::Camera;
use crate::dataset::picture::decode::interleaved;
use crate::dataset::recover::mp4_index::{self, Sample};
use crate::dataset::DatasetError;

/// The quantiser: at 18 people see no difference; LeRobot's AV1 is coarser.
const QUANTISER: u8 = 18;
/// Never reached, so that the quantiser alone decides.
const BITS_PER_SECOND: u32 = 200_000_000;
/// Distance of key frames, LeRobot's `g`.
const KEY_EVERY: u32 = 2;
/// Most bytes of a picture's file besides pixels.
const MAX_REST: u64 = 1 << 20;
/// Sides that the encoder takes.
const SIDES: std::ops::RangeInclusive<usize> = 16..=2160;

/// Why these pictures cannot be encoded, if so: a disk that lost power leaves cut ones.
pub(crate) fn refusal(camera: &Camera, pictures: &[PathBuf]) -> Option<String> {
    let Camera {
        name,
        height,
        width,
        ..
    } = camera;
    let fits = |side: &usize| SIDES.contains(side) && side.is_multiple_of(2);
    if !fits(height) || !fits(width) {
        return Some(format!(
            "{name}: pictures of {height} x {width} (height x width) cannot be encoded; both sides have to be even, and 16 to 2160"
        ));
    }
    let mut faults = pictures.iter().filter_map(|path| read(path, camera).err());
    faults.next().map(|fault| fault.to_string())
}

/// Writes the episodes' pictures to `out`, episode after episode.
pub(crate) fn write_mp4(
    out: &Path,
    camera: &Camera,
    fps: u32,
    episodes: &[Vec<PathBuf>],
) -> Result<(), DatasetError> {
    let io = |e: std::io::Error| DatasetError::write(out, e);
    let failed =
        |e: openh264::Error| DatasetError::video(out, format!("OpenH264 cannot encode it: {e}"));
    let config = EncoderConfig::new()
        .profile(Profile::Main)
        .bitrate(BitRate::from_bps(BITS_PER_SECOND))
        .max_frame_rate(FrameRate::from_hz(fps as f32))
        // Other modes warn on stderr before the crate silences the library. The quantiser is the same.
        .rate_control_mode(RateControlMode::Bufferbased)
        .qp(QpRange::new(QUANTISER, QUANTISER))
        .skip_frames(false)
        .scene_change_detect(false)
        .background_detection(false)
        .adaptive_quantization(false)
        .num_threads(1)
        .intra_frame_period(IntraFramePeriod::from_num_frames(KEY_EVERY));
    let mut encoder =
        Encoder::with_api_config(OpenH264API::from_source(), config).map_err(failed)?;
    let mut file = File::create_new(out).map_err(io)?;
    file.write_all(&mp4_index::start()).map_err(io)?;
    let (mut samples, mut parameter_sets) = (Vec::new(), [Vec::new(), Vec::new()]);
    let mut at = mp4_index::start().len() as u64;
    for pictures in episodes {
        encoder.force_intra_frame();
        for picture in pictures {
            let planes = Planes::of(&read(picture, camera)?, camera);
            let stream = encoder.encode(&planes.slices()).map_err(failed)?.to_vec();
            let mut sample = Sample {
                at,
                len: 0,
                key: false,
            };
            for unit in openh264::nal_units(&stream) {
                let Some((unit, kind)) = without_start_code(unit) else {
                    continue;
                };
                match kind {
                    7 => parameter_sets[0] = unit.to_vec(),
                    8 => parameter_sets[1] = unit.to_vec(),
                    kind => {
                        sample.key |= kind == 5;
                        let len = unit.len() as u32;
                        file.write_all(&len.to_be_bytes()).map_err(io)?;
                        file.write_all(unit).map_err(io)?;
                        sample.len += 4 + len;
                    }
                }
            }
            at += u64::from(sample.len);
            samples.push(sample);
        }
    }
    let index = mp4_index::index(&samples, &parameter_sets, camera, fps).ok_or_else(|| {
        DatasetError::video(out, "its pictures are too many for one file, or none")
    })?;
    file.write_all(&index).map_err(io)?;
    file.seek(SeekFrom::Start(mp4_index::LENGTH_AT))
        .map_err(io)?;
    file.write_all(&mp4_index::length(at)).map_err(io)?;
    file.sync_all().map_err(io)
}

/// A NAL unit without its start code, and its type.
fn without_start_code(unit: &[u8]) -> Option<(&[u8], u8)> {
    let start = unit.iter().position(|&byte| byte == 1)? + 1;
    let end = unit.iter().rposition(|&byte| byte != 0)? + 1;
    let unit = unit.get(start..end)?;
    Some((unit, unit.first()? & 0x1f))
}

/// LeRobot's PNG of `height x width`, three bytes a pixel.
fn read(path: &Path, camera: &Camera) -> Result<Vec<u8>, DatasetError> {
    let most = (camera.height * camera.width * 3) as u64 + MAX_REST;
    let encoded = bounded_file::read(path, most).map_err(|e| DatasetError::io(path, e))?;
    interleaved(&encoded, camera.height, camera.width)
        .map_err(|cause| DatasetError::video(path, cause))
}

/// A picture as BT.601 of limited range, 4:2:0.
struct Planes {
    y: Vec<u8>,
    u: Vec<u8>,
    v: Vec<u8>,
    width: usize,
    height: usize,
}

impl Planes {
    /// From RGB, three bytes a pixel, even sides.
    fn of(rgb: &[u8], camera: &Camera) -> Self {
        let Camera { height, width, .. } = *camera;
        let half = width / 2;
        let mut planes = Self {
            y: vec![0; height * width],
            u: vec![0; height / 2 * half],
            v: vec![0; height / 2 * half],
            width,
            height,
        };
        let mut sums = vec![[0i32; 3]; planes.u.len()];
        for (at, pixel) in rgb.chunks_exact(3).enumerate() {
            let [r, g, b] = [pixel[0], pixel[1], pixel[2]].map(i32::from);
            // BT.601's weights times 2^16 and 219 / 255.
            planes.y[at] = level(((16829 * r + 33039 * g + 6416 * b + (1 << 15)) >> 16) + 16);
            let sum = &mut sums[at / width / 2 * half + at % width / 2];
            [r, g, b]
                .iter()
                .zip(sum)
                .for_each(|(value, sum)| *sum += value);
        }
        for (at, [r, g, b]) in sums.into_iter().enumerate() {
            // Sums of four pixels; BT.601's weights times 2^16 and 224 / 255.
            planes.u[at] = level(((-9714 * r - 19070 * g + 28784 * b + (1 << 17)) >> 18) + 128);
            planes.v[at] = level(((28784 * r - 24103 * g - 4681 * b + (1 << 17)) >> 18) + 128);
        }
        planes
    }

    fn slices(&self) -> YUVSlices<'_> {
        let half = self.width / 2;
        YUVSlices::new(
            (&self.y, &self.u, &self.v),
            (self.width, self.height),
            (self.width, half, half),
        )
    }
}

fn level(x: i32) -> u8 {
    x.clamp(0, 255) as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::CameraStorage;

    #[test]
    fn sides_that_cannot_be_encoded_are_named() {
        let of = |height, width| {
            let camera = Camera {
                name: "top".into(),
                feature: "top".into(),
                height,
                width,
                storage: CameraStorage::Video,
            };
            refusal(&camera, &[])
        };
        assert_eq!(of(16, 2160), None);
        for (height, width) in [(47, 64), (48, 63), (14, 64), (48, 2162)] {
            let size =
                format!("top: pictures of {height} x {width} (height x width) cannot be encoded");
            assert!(of(height, width).unwrap().starts_with(&size));
        }
    }
}
