//! A video of any length that repeats another's frames.

use std::fs::{self, File};
use std::path::Path;
use zk0_lerobot::dataset::Mp4Track;

/// Ticks per second, and per frame.
const SCALE: u32 = 30;

/// An mp4 of `frames` frames at 30 a second. They repeat the first frame of `video` if still, otherwise all.
pub fn made(video: &Path, frames: usize, still: bool) -> Vec<u8> {
    let track = Mp4Track::read(&mut File::open(video).unwrap()).unwrap();
    let bytes = fs::read(video).unwrap();
    let head = atom(b"ftyp", &[&b"isom\0\0\x02\0isomav01"[..]]);
    // Data come first, so their places do not depend on the index.
    let start = head.len() as u64 + 8;
    let (mut data, mut places) = (Vec::new(), Vec::new());
    for sample in &track.samples {
        places.push((start + data.len() as u64, sample.size, sample.key));
        let from = sample.offset as usize;
        data.extend(&bytes[from..from + sample.size as usize]);
    }
    let count = if still { 1 } else { places.len() };
    let shown: Vec<_> = (0..frames).map(|frame| places[frame % count]).collect();
    let numbers = |values: &mut dyn Iterator<Item = u32>| -> Vec<u8> {
        values.flat_map(u32::to_be_bytes).collect()
    };
    let all = frames as u32;
    let mut keys = (1..).zip(&shown).filter(|(_, place)| place.2);
    let keys: Vec<u32> = keys.by_ref().map(|(number, _)| number).collect();
    let table = atom(
        b"stbl",
        &[
            description(&bytes),
            &atom(b"stts", &[&numbers(&mut [0, 1, all, 1].into_iter())]),
            &atom(
                b"stss",
                &[&numbers(
                    &mut [0, keys.len() as u32].into_iter().chain(keys),
                )],
            ),
            &atom(b"stsc", &[&numbers(&mut [0, 1, 1, 1, 1].into_iter())]),
            &atom(
                b"stsz",
                &[&numbers(
                    &mut [0, 0, all]
                        .into_iter()
                        .chain(shown.iter().map(|place| place.1)),
                )],
            ),
            &atom(
                b"stco",
                &[&numbers(
                    &mut [0, all]
                        .into_iter()
                        .chain(shown.iter().map(|place| place.0 as u32)),
                )],
            ),
        ],
    );
    let header = |body: &[u32]| numbers(&mut body.iter().copied());
    let media = atom(
        b"mdia",
        &[
            &atom(b"mdhd", &[&header(&[0, 0, 0, SCALE, all, 0])]),
            &atom(b"hdlr", &[&[0; 8], &b"vide"[..], &[0; 13]]),
            &atom(b"minf", &[&table]),
        ],
    );
    let index = atom(
        b"moov",
        &[
            // Rate, volume and matrix stay zero.
            &atom(b"mvhd", &[&header(&[0, 0, 0, SCALE, all]), &[0; 80]]),
            &atom(b"trak", &[&media]),
        ],
    );
    [head, atom(b"mdat", &[&data]), index].concat()
}

fn atom(kind: &[u8; 4], parts: &[&[u8]]) -> Vec<u8> {
    let body = parts.concat();
    let length = (body.len() as u32 + 8).to_be_bytes();
    [&length[..], kind, &body].concat()
}

fn description(file: &[u8]) -> &[u8] {
    let at = file.windows(4).position(|name| name == b"stsd").unwrap() - 4;
    let length = u32::from_be_bytes(file[at..at + 4].try_into().unwrap());
    &file[at..at + length as usize]
}
