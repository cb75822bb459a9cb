//! Random damage to every kind of file ends in an error or in a value. It never causes a panic, or an allocation as large as the
//! damaged file claims.

use std::fs;

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use zk0_lerobot::dataset::VideoReader;
use zk0_testkit::allocations::{alone, largest};
use zk0_testkit::recordings::{fixtures, recording, Copy, DATA};

#[test]
fn parquet_files_cut_anywhere() {
    let _alone = alone();
    for file in [
        DATA,
        "meta/tasks.parquet",
        "meta/episodes/chunk-000/file-000.parquet",
    ] {
        let copy = Copy::default();
        let whole = fs::read(copy.path(file)).unwrap();
        for part in 0..20 {
            copy.edit(file, |_| whole[..whole.len() * part / 20].to_vec());
            copy.fails(file, "damaged parquet file");
        }
    }
}

/// Random damage found this: with this byte changed, the parquet crate (60.1) panics.
#[test]
fn a_panic_of_the_parquet_crate_becomes_an_error() {
    let _alone = alone();
    let copy = Copy::default();
    copy.edit(DATA, |mut bytes| {
        bytes[959] = 0;
        bytes
    });
    copy.fails(DATA, "damaged parquet file: ");
}

/// Damages the bytes at random: changes a few bytes, overwrites a stretch, or cuts the end off.
fn damaged(bytes: &[u8], rng: &mut ChaCha8Rng) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    // Half of the damage hits the first 2 KiB, where the mp4's index is, or the last 2 KiB, where parquet's index is.
    let near = |rng: &mut ChaCha8Rng, len: usize| match rng.random_range(0..4) {
        0 => rng.random_range(0..len.min(2048)),
        1 => len - 1 - rng.random_range(0..len.min(2048)),
        _ => rng.random_range(0..len),
    };
    match rng.random_range(0..8) {
        0 => bytes.truncate(near(rng, bytes.len())),
        1 => {
            let at = near(rng, bytes.len());
            let end = (at + rng.random_range(1..64)).min(bytes.len());
            rng.fill(&mut bytes[at..end]);
        }
        // Lengths and counts have 32 bits. This makes one of them huge.
        2 => {
            let at = near(rng, bytes.len());
            let end = (at + 4).min(bytes.len());
            bytes[at..end].fill(if rng.random() { 0xff } else { 0x7f });
        }
        _ => {
            for _ in 0..rng.random_range(1..4) {
                let at = near(rng, bytes.len());
                bytes[at] = rng.random();
            }
        }
    }
    bytes
}

/// The largest allocation that is allowed, whatever a file claims: decoder state and buffers.
const ENOUGH: usize = 64 << 20;

#[test]
fn random_damage_to_a_video_never_panics() {
    let _alone = alone();
    let ((), largest) = largest(read_damaged_videos);
    assert!(largest < ENOUGH, "{largest}");
}

fn read_damaged_videos() {
    let source =
        recording("so100_sorting").join("videos/observation.images.wrist/chunk-000/file-001.mp4");
    let whole = fs::read(source).unwrap();
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("damaged.mp4");
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let (mut refused, mut undecodable, mut decoded) = (0, 0, 0);
    for _ in 0..2000 {
        fs::write(&path, damaged(&whole, &mut rng)).unwrap();
        match VideoReader::open(&path, 96, 128) {
            Err(_) => refused += 1,
            Ok(mut video) => {
                // The test decodes a few frames of each video, because all of them would take minutes.
                let at = rng.random_range(0..video.len());
                match (at..video.len().min(at + 4)).find_map(|n| video.rgb(n).err()) {
                    Some(_) => undecodable += 1,
                    None => decoded += 1,
                }
            }
        }
    }
    println!(
        "of 2000 damaged videos {refused} refused, {undecodable} not decodable, {decoded} decoded"
    );
    assert!(refused > 100 && undecodable > 20 && decoded > 100);
}

/// FFmpeg decodes these videos, as far as it gets them.
#[test]
fn random_damage_to_a_hevc_video_never_panics() {
    let _alone = alone();
    let ((), largest) = largest(|| {
        let source = fixtures().join("videos_other/hevc_hvc1.mp4");
        let whole = fs::read(source).unwrap();
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("damaged.mp4");
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let (mut refused, mut decoded) = (0, 0);
        for _ in 0..100 {
            fs::write(&path, damaged(&whole, &mut rng)).unwrap();
            let read = VideoReader::open(&path, 48, 64)
                .and_then(|mut video| (0..video.len()).try_for_each(|n| video.rgb(n).map(drop)));
            match read {
                Ok(()) => decoded += 1,
                Err(_) => refused += 1,
            }
        }
        println!("of 100 damaged videos {refused} refused, {decoded} decoded");
        assert!(refused > 10 && decoded > 10);
    });
    assert!(largest < ENOUGH, "{largest}");
}

#[test]
fn random_damage_to_a_parquet_file_never_panics() {
    let _alone = alone();
    let ((), largest) = largest(open_damaged_tables);
    assert!(largest < ENOUGH, "{largest}");
}

fn open_damaged_tables() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    for file in [
        DATA,
        "meta/tasks.parquet",
        "meta/episodes/chunk-000/file-000.parquet",
    ] {
        let copy = Copy::default();
        let whole = fs::read(copy.path(file)).unwrap();
        let mut refused = 0;
        for _ in 0..500 {
            copy.edit(file, |_| damaged(&whole, &mut rng));
            refused += usize::from(copy.open().is_err());
        }
        assert!(refused > 100, "{file}: {refused}");
    }
}
