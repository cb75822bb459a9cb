//! Writes H.264 into an mp4 like FFmpeg's.

use openh264::encoder::{
    BitRate, Encoder, EncoderConfig, FrameRate, IntraFramePeriod, Profile, RateControlMode,
};
use openh264::formats::{RgbSliceU8, YUVBuffer};
use openh264::OpenH264API;

/// A picture in decoding order.
pub struct Encoded {
    /// Without start codes or parameter sets.
    pub units: Vec<Vec<u8>>,
    /// Whether it needs no other.
    pub key: bool,
}

/// An encoded video.
pub struct EncodedVideo {
    /// SPS and PPS.
    pub parameter_sets: [Vec<u8>; 2],
    /// In decoding order.
    pub pictures: Vec<Encoded>,
    /// With start codes.
    pub annex_b: Vec<Vec<u8>>,
}

/// Encodes pictures (`[3, height, width]` RGB) with a key frame every `period`.
pub fn encode(
    pictures: &[Vec<u8>],
    height: usize,
    width: usize,
    profile: Profile,
    period: u32,
) -> EncodedVideo {
    let config = EncoderConfig::new()
        .profile(profile)
        .bitrate(BitRate::from_bps(4_000_000))
        .max_frame_rate(FrameRate::from_hz(30.0))
        .rate_control_mode(RateControlMode::Quality)
        .skip_frames(false)
        .scene_change_detect(false)
        .intra_frame_period(IntraFramePeriod::from_num_frames(period));
    let mut encoder = Encoder::with_api_config(OpenH264API::from_source(), config).unwrap();
    let mut stream = EncodedVideo {
        parameter_sets: [Vec::new(), Vec::new()],
        pictures: Vec::new(),
        annex_b: Vec::new(),
    };
    for picture in pictures {
        let plane = height * width;
        let interleaved: Vec<u8> = (0..plane)
            .flat_map(|i| [picture[i], picture[plane + i], picture[2 * plane + i]])
            .collect();
        let yuv = YUVBuffer::from_rgb8_source(RgbSliceU8::new(&interleaved, (width, height)));
        let bytes = encoder.encode(&yuv).unwrap().to_vec();
        let mut encoded = Encoded {
            units: Vec::new(),
            key: false,
        };
        for unit in openh264::nal_units(&bytes) {
            let unit = &unit[3..];
            let end = unit.iter().rposition(|&b| b != 0).unwrap() + 1;
            let unit = unit[..end].to_vec();
            match unit[0] & 0x1f {
                7 => stream.parameter_sets[0] = unit,
                8 => stream.parameter_sets[1] = unit,
                kind => {
                    encoded.key |= kind == 5;
                    encoded.units.push(unit);
                }
            }
        }
        stream.pictures.push(encoded);
        stream.annex_b.push(bytes);
    }
    stream
}

impl EncodedVideo {
    /// At 30 frames a second, in decoding order.
    pub fn mp4(&self, height: usize, width: usize) -> Vec<u8> {
        let shown: Vec<u32> = (0..self.pictures.len() as u32).collect();
        self.mp4_shown(height, width, &shown)
    }

    /// Shows decoded picture `i` as number `shown[i]`, by offsets (`ctts`) and an edit list.
    pub fn mp4_shown(&self, height: usize, width: usize, shown: &[u32]) -> Vec<u8> {
        const SCALE: u32 = 15360;
        const TICK: u32 = SCALE / 30;
        let samples: Vec<Vec<u8>> = self
            .pictures
            .iter()
            .map(|p| p.units.iter().flat_map(|u| length_and(u, 4)).collect())
            .collect();
        // No picture is shown before it is decoded, so all are as late as the latest needs.
        let late = |(i, &n): (usize, &u32)| (i as u32).saturating_sub(n);
        let shift = shown.iter().enumerate().map(late).max().unwrap();
        let offsets = shown
            .iter()
            .enumerate()
            .map(|(i, n)| (n + shift - i as u32) * TICK);

        let ftyp = boxed(b"ftyp", &[b"isom", &[0, 0, 2, 0], b"isomavc1"]);
        let mdat = boxed(
            b"mdat",
            &samples.iter().map(Vec::as_slice).collect::<Vec<_>>(),
        );
        let first = (ftyp.len() + 8) as u32;
        let count = samples.len() as u32;
        let [sps, pps] = &self.parameter_sets;
        let avcc = boxed(
            b"avcC",
            &[
                &[1, sps[1], sps[2], sps[3], 0xff, 0xe1],
                &length_and(sps, 2),
                &[1],
                &length_and(pps, 2),
            ],
        );
        let size = [(width as u16).to_be_bytes(), (height as u16).to_be_bytes()].concat();
        let entry = boxed(
            b"avc1",
            &[&[0; 6], &[0, 1], &[0; 16], &size, &[0; 50], &avcc],
        );
        let keys: Vec<u32> = (1..=count)
            .filter(|n| self.pictures[*n as usize - 1].key)
            .collect();
        let table = boxed(
            b"stbl",
            &[
                &boxed(b"stsd", &[&words(&[0, 1]), &entry]),
                &boxed(b"stts", &[&words(&[0, 1, count, TICK])]),
                &boxed(
                    b"ctts",
                    &[
                        &words(&[0, count]),
                        &offsets.flat_map(|o| words(&[1, o])).collect::<Vec<_>>(),
                    ],
                ),
                &boxed(b"stss", &[&words(&[0, keys.len() as u32]), &words(&keys)]),
                &boxed(b"stsc", &[&words(&[0, 1, 1, count, 1])]),
                &boxed(
                    b"stsz",
                    &[
                        &words(&[0, 0, count]),
                        &samples
                            .iter()
                            .flat_map(|s| words(&[s.len() as u32]))
                            .collect::<Vec<_>>(),
                    ],
                ),
                &boxed(b"stco", &[&words(&[0, 1, first])]),
            ],
        );
        let media = boxed(
            b"mdia",
            &[
                &boxed(b"mdhd", &[&words(&[0, 0, 0, SCALE, count * TICK, 0])]),
                &boxed(b"hdlr", &[&words(&[0, 0]), b"vide", &[0; 13]]),
                &boxed(b"minf", &[&table]),
            ],
        );
        let edits = boxed(
            b"edts",
            &[&boxed(
                b"elst",
                &[&words(&[0, 1, count * 1000 / 30, shift * TICK, 0x1_0000])],
            )],
        );
        let movie = boxed(
            b"mvhd",
            &[&words(&[0, 0, 0, 1000, count * 1000 / 30]), &[0; 80]],
        );
        let moov = boxed(b"moov", &[&movie, &boxed(b"trak", &[&edits, &media])]);
        [ftyp, mdat, moov].concat()
    }
}

fn boxed(kind: &[u8; 4], parts: &[&[u8]]) -> Vec<u8> {
    let len: usize = 8 + parts.iter().map(|p| p.len()).sum::<usize>();
    let mut bytes = (len as u32).to_be_bytes().to_vec();
    bytes.extend(kind);
    parts.iter().for_each(|p| bytes.extend(*p));
    bytes
}

fn words(values: &[u32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_be_bytes()).collect()
}

fn length_and(unit: &[u8], bytes: usize) -> Vec<u8> {
    [&(unit.len() as u32).to_be_bytes()[4 - bytes..], unit].concat()
}
