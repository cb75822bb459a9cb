//! Random damage to every kind of file ends in an error or in a value. It never causes a panic, or an allocation as large as the
//! damaged file claims.

use std::fs;
use std::io::{Cursor, Read};

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use zk0_lerobot::dataset::{DatasetError, Mp4Track, VideoReader};
use zk0_testkit::allocations::{alone, largest, peak};
use zk0_testkit::recordings::{fixtures, recording, with_column, Copy, DATA};

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

/// Prints how many of 40 damaged bytes within pictures are noticed, and how many give other pixels, which no decoder can tell from what was
/// filmed. Only a checksum of the picture can, which an encoder may write.
#[test]
fn how_often_a_damaged_byte_within_a_picture_is_noticed() {
    let _alone = alone();
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("damaged.mp4");
    let pictures = |bytes: &[u8]| -> Result<Vec<Vec<u8>>, DatasetError> {
        fs::write(&path, bytes).unwrap();
        let mut video = VideoReader::open(&path, 48, 64)?;
        (0..video.len()).map(|n| video.rgb(n)).collect()
    };
    for name in ["av1_bt709", "h264_plain", "hevc_hvc1", "hevc_checksums"] {
        let whole = fs::read(fixtures().join(format!("videos_other/{name}.mp4"))).unwrap();
        let track = Mp4Track::read(&mut Cursor::new(&whole)).unwrap();
        let right = pictures(&whole).unwrap();
        let (mut noticed, mut others) = (0, 0);
        for _ in 0..40 {
            let sample = &track.samples[rng.random_range(1..track.samples.len())];
            let (at, size) = (sample.offset as usize, sample.size as usize);
            let mut damaged = whole.clone();
            damaged[at + rng.random_range(size / 4..size)] ^= rng.random_range(1..=255);
            match pictures(&damaged) {
                Ok(pictures) => others += usize::from(pictures != right),
                Err(_) => noticed += 1,
            }
        }
        println!("{name}: {noticed} of 40 noticed, {others} give other pixels");
        assert!(
            others == 0 || name != "hevc_checksums",
            "{name}: {others} of 40 give other pixels"
        );
    }
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

/// Every codec and both versions of pages: what they claim is checked before it is decompressed.
#[test]
fn random_damage_to_a_table_of_another_writer_never_panics() {
    let _alone = alone();
    let ((), largest) = largest(open_damaged_tables_of_others);
    assert!(largest < ENOUGH, "{largest}");
}

fn open_damaged_tables_of_others() {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    for writer in [
        "pyarrow_gzip_pages2",
        "pyarrow_brotli_pages1",
        "pyarrow_lz4_pages1",
        "pyarrow_zstd_pages2",
        "pyarrow_delta_byte_array",
        "duckdb_v2_zstd",
        "polars",
    ] {
        let copy = Copy::of("so100_sorting_two");
        copy.add(&fixtures().join("tables").join(writer));
        for file in [DATA, "meta/tasks.parquet"] {
            let whole = fs::read(copy.path(file)).unwrap();
            let mut refused = 0;
            for _ in 0..300 {
                copy.edit(file, |_| damaged(&whole, &mut rng));
                refused += usize::from(copy.open().is_err());
            }
            assert!(refused > 60, "{writer} {file}: {refused}");
            copy.edit(file, |_| whole);
        }
    }
}

/// The first picture of a camera in a recording whose pictures are in files beside the tables.
const PICTURE: &str = "images/observation.images.top/episode-000000/frame-000000.png";

fn recording_with_pictures() -> Copy {
    let copy = Copy::empty();
    for name in ["lerobot", "beside"] {
        copy.add(&fixtures().join("pictures").join(name));
    }
    copy
}

#[test]
fn random_damage_to_a_picture_never_panics() {
    let _alone = alone();
    let ((), largest) = largest(read_damaged_pictures);
    assert!(largest < ENOUGH, "{largest}");
}

fn read_damaged_pictures() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let copy = recording_with_pictures();
    let png = fs::read(copy.path(PICTURE)).unwrap();
    let jpeg = fs::read(fixtures().join("pictures/odd/upright.jpg")).unwrap();
    let progressive = fs::read(fixtures().join("pictures/odd/progressive.jpg")).unwrap();
    for (name, whole) in [("png", png), ("jpeg", jpeg), ("progressive", progressive)] {
        copy.edit(PICTURE, |_| whole.clone());
        let dataset = copy.open().unwrap();
        dataset.frame(0, 10).unwrap();
        let mut refused = 0;
        for _ in 0..1000 {
            copy.edit(PICTURE, |_| damaged(&whole, &mut rng));
            let error = dataset.frame(0, 10).err();
            assert!(
                matches!(error, None | Some(DatasetError::Picture { .. })),
                "{error:?}"
            );
            refused += usize::from(error.is_some());
        }
        println!("{name}: {refused} of 1000 refused");
        assert!(refused > 200, "{name}: {refused}");
    }
}

/// LeRobot's Pillow refuses such a profile. It states nothing about the pixels that are stored.
#[test]
fn a_colour_profile_is_not_unpacked() {
    let _alone = alone();
    let copy = recording_with_pictures();
    let zeros = std::io::repeat(0).take(15 << 20);
    let mut profile = b"iCCPname\0\0".to_vec();
    flate2::read::ZlibEncoder::new(zeros, flate2::Compression::best())
        .read_to_end(&mut profile)
        .unwrap();
    let mut crc = flate2::Crc::new();
    crc.update(&profile);
    let len = (profile.len() as u32 - 4).to_be_bytes();
    copy.edit(PICTURE, |png| {
        let (head, rest) = png.split_at(33);
        [head, &len, &profile, &crc.sum().to_be_bytes(), rest].concat()
    });
    let dataset = copy.open().unwrap();
    let (frame, largest) = largest(|| dataset.frame(0, 10));
    frame.unwrap();
    assert!(largest < 1 << 20, "{largest}");
}

/// A page with its pictures is held, and not those of a whole file.
#[test]
fn pictures_are_read_page_by_page() {
    use arrow_array::cast::AsArray;
    use arrow_array::{ArrayRef, BinaryArray, StructArray};
    use parquet::arrow::ArrowWriter;
    use parquet::file::properties::WriterProperties;
    use std::sync::Arc;

    let _alone = alone();
    let copy = Copy::empty();
    copy.add(&fixtures().join("pictures/lerobot"));
    let mut rng = ChaCha8Rng::seed_from_u64(6);
    // Bytes after the end of a picture are not read, and no codec makes random ones fewer.
    let mut junk = vec![0; 2 << 20];
    rng.fill(&mut junk[..]);
    let mut table = None;
    copy.edit_table(DATA, |rows| {
        table = Some(rows.clone());
        vec![rows]
    });
    let mut rows = table.unwrap();
    for camera in ["observation.images.wrist", "observation.images.top"] {
        let pictures = rows.column_by_name(camera).unwrap().as_struct().clone();
        let (fields, mut parts, nulls) = pictures.into_parts();
        let bytes = fields.iter().position(|f| f.name() == "bytes").unwrap();
        let long: BinaryArray = parts[bytes]
            .as_binary::<i32>()
            .iter()
            .map(|picture| Some([picture.unwrap(), &junk].concat()))
            .collect();
        parts[bytes] = Arc::new(long) as ArrayRef;
        let pictures = StructArray::new(fields, parts, nulls);
        rows = with_column(rows, camera, Arc::new(pictures));
    }
    let groups_of_one = WriterProperties::builder().set_max_row_group_row_count(Some(1));
    let file = fs::File::create(copy.path(DATA)).unwrap();
    let mut writer =
        ArrowWriter::try_new(file, rows.schema(), Some(groups_of_one.build())).unwrap();
    writer.write(&rows).unwrap();
    writer.close().unwrap();
    assert!(fs::metadata(copy.path(DATA)).unwrap().len() > 32 << 20);
    let dataset = copy.open().unwrap();
    let (pixels, most) = peak(|| {
        let mut loader = dataset.loader(10).unwrap();
        let mut picture = |at| loader.frame(at).unwrap().images[1].pixels.clone();
        [5, 6, 0, 7].map(&mut picture)
    });
    assert!(pixels.iter().all(|p| p.len() == 3 * 24 * 40));
    // Two cameras, each with a page of one picture: compressed, decompressed, as a dictionary, and cut out of it.
    assert!(most < 20 << 20, "{most}");
}
