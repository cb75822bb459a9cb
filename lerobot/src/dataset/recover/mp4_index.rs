//! The boxes of an mp4 with one H.264 track around consecutive samples (ISO/IEC 14496-12 and -15).

use crate::dataset::metadata::info::Camera;

/// Offset of the length of the samples' box (`mdat`).
pub(crate) const LENGTH_AT: u64 = 32;
/// Ticks of a frame, as in FFmpeg.
const TICKS: u32 = 512;

pub(crate) struct Sample {
    pub at: u64,
    pub len: u32,
    pub key: bool,
}

/// What precedes the samples; the length at [`LENGTH_AT`] is set later.
pub(crate) fn start() -> Vec<u8> {
    let kind = boxed(b"ftyp", &[b"isom", &[0, 0, 2, 0], b"isomavc1"]);
    // Length 1: the eight bytes after the name hold the length.
    [&kind[..], &[0, 0, 0, 1], b"mdat", &[0; 8]].concat()
}

/// For samples that end at byte `end`.
pub(crate) fn length(end: u64) -> [u8; 8] {
    (end + 16 - start().len() as u64).to_be_bytes()
}

/// What follows the samples (`moov`); `None` for no samples, or too many for the boxes.
pub(crate) fn index(
    samples: &[Sample],
    parameter_sets: &[Vec<u8>; 2],
    camera: &Camera,
    fps: u32,
) -> Option<Vec<u8>> {
    let [sps, pps] = parameter_sets;
    let profile = sps.get(1..4)?;
    pps.first()?;
    let (count, scale) = (u32::try_from(samples.len()).ok()?, fps * TICKS);
    let duration = count.checked_mul(TICKS)?;
    let length_and = |unit: &[u8]| [&(unit.len() as u16).to_be_bytes(), unit].concat();
    let avcc = boxed(
        b"avcC",
        &[
            &[1],
            profile,
            &[0xff, 0xe1],
            &length_and(sps),
            &[1],
            &length_and(pps),
        ],
    );
    let sides = [camera.width as u16, camera.height as u16];
    let size = sides.map(u16::to_be_bytes).concat();
    let resolution = words(&[0x48_0000, 0x48_0000, 0]);
    let entry = boxed(
        b"avc1",
        &[
            &[0, 0, 0, 0, 0, 0, 0, 1], // the first data reference
            &[0; 16],
            &size,
            &resolution,
            &[0, 1], // one frame for each sample
            &[0; 32],
            &[0, 24, 0xff, 0xff],
            &avcc,
        ],
    );
    let each = |of: fn(&Sample) -> Vec<u8>| samples.iter().flat_map(of).collect::<Vec<u8>>();
    let keys: Vec<u32> = (1..)
        .zip(samples)
        .filter(|(_, s)| s.key)
        .map(|(n, _)| n)
        .collect();
    let table = boxed(
        b"stbl",
        &[
            &boxed(b"stsd", &[&words(&[0, 1]), &entry]),
            &boxed(b"stts", &[&words(&[0, 1, count, TICKS])]),
            &boxed(b"stss", &[&words(&[0, keys.len() as u32]), &words(&keys)]),
            &boxed(b"stsc", &[&words(&[0, 1, 1, 1, 1])]),
            &boxed(
                b"stsz",
                &[
                    &words(&[0, 0, count]),
                    &each(|s| s.len.to_be_bytes().into()),
                ],
            ),
            &boxed(
                b"co64",
                &[&words(&[0, count]), &each(|s| s.at.to_be_bytes().into())],
            ),
        ],
    );
    let here = boxed(b"url ", &[&words(&[1])]);
    let data = boxed(b"dinf", &[&boxed(b"dref", &[&words(&[0, 1]), &here])]);
    let video = boxed(b"vmhd", &[&words(&[1, 0, 0])]);
    let language = words(&[0x55c4_0000]); // undetermined
    let media = boxed(
        b"mdia",
        &[
            &boxed(b"mdhd", &[&words(&[0, 0, 0, scale, duration]), &language]),
            &boxed(b"hdlr", &[&words(&[0, 0]), b"vide", &[0; 13]]),
            &boxed(b"minf", &[&video, &data, &table]),
        ],
    );
    let matrix = words(&[0x1_0000, 0, 0, 0, 0x1_0000, 0, 0, 0, 0x4000_0000]);
    let header = boxed(
        b"tkhd",
        &[
            &words(&[3, 0, 0, 1, 0, duration, 0, 0, 0, 0]), // enabled, track 1
            &matrix,
            &words(&sides.map(|side| u32::from(side) << 16)),
        ],
    );
    let movie = boxed(
        b"mvhd",
        &[
            &words(&[0, 0, 0, scale, duration, 0x1_0000, 0x100_0000, 0, 0]),
            &matrix,
            &words(&[0, 0, 0, 0, 0, 0, 2]), // the next track would be number 2
        ],
    );
    let track = boxed(b"trak", &[&header, &media]);
    Some(boxed(b"moov", &[&movie, &track]))
}

fn boxed(kind: &[u8; 4], parts: &[&[u8]]) -> Vec<u8> {
    let len: usize = 8 + parts.iter().map(|part| part.len()).sum::<usize>();
    let mut bytes = (len as u32).to_be_bytes().to_vec();
    bytes.extend(kind);
    parts.iter().for_each(|part| bytes.extend(*part));
    bytes
}

fn words(values: &[u32]) -> Vec<u8> {
    values
        .iter()
        .flat_map(|value| value.to_be_bytes())
        .collect()
}
