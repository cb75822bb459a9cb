//! Recordings whose pictures are stored one by one, as LeRobot 0.6.1 makes them with `use_videos=False`.

use std::collections::BTreeMap;
use std::fs;
use std::sync::Arc;

use arrow_array::{Array, ArrayRef, BinaryArray, StringArray, StructArray};
use parquet::arrow::ArrowWriter;
use parquet::basic::{Compression, Encoding};
use parquet::file::properties::WriterProperties;
use parquet::schema::types::ColumnPath;
use rand::seq::SliceRandom;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use zk0_lerobot::dataset::{CameraStorage, Dataset, Loader, Window};
use zk0_testkit::recordings::{fixtures, with_column, Copy, DATA, INFO};

const WRIST: &str = "observation.images.wrist";
const TOP: &str = "observation.images.top";
const FIRST: &str = "images/observation.images.wrist/episode-000000/frame-000000.png";
const PIXELS: usize = 3 * 24 * 40;
const FRAMES: usize = 8;

/// LeRobot's recording with pictures, with the files of `folder` in place of its own.
fn recorded(folder: &str) -> Copy {
    let copy = Copy::empty();
    for name in ["lerobot", folder] {
        copy.add(&fixtures().join("pictures").join(name));
    }
    copy
}

/// The pixels that LeRobot reads, per frame and camera.
fn read_by_lerobot(name: &str) -> Vec<Vec<Vec<u8>>> {
    let bytes = fs::read(fixtures().join("pictures").join(name).with_extension("rgb")).unwrap();
    assert_eq!(bytes.len(), FRAMES * 2 * PIXELS);
    let frames = bytes.chunks(2 * PIXELS);
    frames
        .map(|frame| frame.chunks(PIXELS).map(<[u8]>::to_vec).collect())
        .collect()
}

/// The largest difference of a pixel, and how many of a thousand differ.
fn difference(dataset: &Dataset, wanted: &[Vec<Vec<u8>>], order: &[usize]) -> (u8, usize) {
    let mut loader = dataset.loader(10).unwrap();
    let (mut largest, mut other, mut all) = (0, 0, 0);
    for &at in order {
        let frame = loader.frame(at).unwrap();
        assert_eq!(frame.images.len(), 2);
        for (image, wanted) in frame.images.iter().zip(&wanted[at]) {
            assert_eq!(
                (image.height, image.width, image.pixels.len()),
                (24, 40, wanted.len())
            );
            for (ours, theirs) in image.pixels.iter().zip(wanted) {
                largest = largest.max(ours.abs_diff(*theirs));
                other += usize::from(ours != theirs);
                all += 1;
            }
        }
    }
    (largest, other * 1000 / all)
}

fn in_order() -> Vec<usize> {
    (0..FRAMES).collect()
}

#[test]
fn png_pictures_are_those_that_lerobot_reads() {
    for folder in ["lerobot", "beside", "mixed"] {
        let copy = recorded(folder);
        let dataset = copy.open().unwrap();
        let wanted = read_by_lerobot(if folder == "mixed" { folder } else { "lerobot" });
        let cameras: Vec<(&str, CameraStorage)> = dataset
            .cameras()
            .iter()
            .map(|c| (c.name.as_str(), c.storage))
            .collect();
        let top = match folder {
            "mixed" => CameraStorage::Video,
            _ => CameraStorage::Pictures,
        };
        // The order of `meta/info.json`, which is not that of the names.
        assert_eq!(cameras, [(WRIST, CameraStorage::Pictures), (TOP, top)]);
        assert_eq!(
            difference(&dataset, &wanted, &in_order()),
            (0, 0),
            "{folder}"
        );
        let mut order = [in_order(), in_order()].concat();
        order.shuffle(&mut ChaCha8Rng::seed_from_u64(1));
        assert_eq!(difference(&dataset, &wanted, &order), (0, 0), "{folder}");
        assert!(dataset.picture_faults(|_, _| ()).is_empty());
    }
}

#[test]
fn a_window_over_several_frames_has_their_pictures() {
    let copy = recorded("lerobot");
    let dataset = copy.open().unwrap();
    let wanted = read_by_lerobot("lerobot");
    let mut window = Window::now(dataset.info());
    window.cameras[1] = vec![-1, 0, 2];
    let mut loader = Loader::new(&dataset, window);
    for (at, shown) in [(0, [0, 0, 2]), (2, [1, 2, 3]), (4, [4, 4, 6])] {
        let images = loader.frame(at).unwrap().images;
        assert!(images[0].pixels == wanted[at][0]);
        for (image, frame) in images[1..].iter().zip(shown) {
            assert!(image.pixels == wanted[frame][1], "{at} {frame}");
        }
    }
}

#[test]
fn jpeg_pictures_are_within_four_levels_of_lerobots() {
    // The format leaves the rounding open. LeRobot's Pillow has libjpeg-turbo.
    let copy = recorded("jpeg");
    let dataset = copy.open().unwrap();
    let (largest, other) = difference(&dataset, &read_by_lerobot("jpeg"), &in_order());
    assert!(largest <= 4 && other < 100, "{largest} {other}");
    // The PNG pictures have other pixels.
    let (largest, _) = difference(&dataset, &read_by_lerobot("lerobot"), &in_order());
    assert!(largest > 8, "{largest}");
}

#[test]
fn pictures_that_lerobot_gives_in_another_form_are_refused() {
    let text = fs::read_to_string(fixtures().join("pictures/odd.json")).unwrap();
    let lerobot: BTreeMap<String, String> = serde_json::from_str(&text).unwrap();
    let fine = "torch.float32 [3, 24, 40]";
    // What LeRobot gives, and what is stated here. A policy takes three channels of one size.
    let cases = [
        ("alpha.png", "torch.float32 [4, 24, 40]", "is Rgba, not RGB"),
        (
            "cmyk.jpg",
            "torch.float32 [4, 24, 40]",
            "is CMYK32, not of three colours",
        ),
        ("cut.jpg", "OSError: Truncated File Read", "damaged"),
        ("cut.png", "OSError: image file is truncated", "damaged"),
        (
            "gray.jpg",
            "torch.float32 [1, 24, 40]",
            "is L8, not of three colours",
        ),
        (
            "gray.png",
            "torch.float32 [1, 24, 40]",
            "is Grayscale, not RGB",
        ),
        (
            "palette.png",
            "torch.float32 [1, 24, 40]",
            "is Indexed, not RGB",
        ),
        ("picture.webp", fine, "neither PNG nor JPEG"),
        (
            "small.png",
            "torch.float32 [3, 20, 20]",
            "20 x 20 (height x width), meta/info.json states 24 x 40",
        ),
        (
            "turned.jpg",
            "torch.float32 [3, 40, 24]",
            "EXIF orientation 6",
        ),
        (
            "turned.png",
            "torch.float32 [3, 40, 24]",
            "EXIF orientation 6",
        ),
    ];
    assert_eq!(lerobot.len(), cases.len() + 2);
    for (file, theirs, cause) in cases {
        assert_eq!(lerobot[file], theirs, "{file}");
        let copy = recorded("beside");
        fs::copy(fixtures().join("pictures/odd").join(file), copy.path(FIRST)).unwrap();
        copy.fails(FIRST, cause);
        copy.fails(
            FIRST,
            "episode 0 frame 0, camera observation.images.wrist: ",
        );
    }
    let copy = recorded("beside");
    assert_eq!(lerobot["upright.jpg"], fine);
    fs::copy(
        fixtures().join("pictures/odd/upright.jpg"),
        copy.path(FIRST),
    )
    .unwrap();
    copy.open().unwrap().frame(0, 10).unwrap();
}

/// Names other files for the pictures of the wrist.
fn name_files(copy: &Copy, name: impl Fn(usize) -> Option<String>) {
    copy.edit_table(DATA, |rows| {
        let pictures = rows.column_by_name(WRIST).unwrap();
        let pictures = pictures.as_any().downcast_ref::<StructArray>().unwrap();
        let paths: StringArray = (0..rows.num_rows()).map(name).collect();
        let (fields, mut parts, nulls) = pictures.clone().into_parts();
        let at = fields.iter().position(|f| f.name() == "path").unwrap();
        parts[at] = Arc::new(paths) as ArrayRef;
        let pictures = StructArray::new(fields, parts, nulls);
        vec![with_column(rows, WRIST, Arc::new(pictures))]
    });
}

#[test]
fn pictures_outside_of_the_folder_are_not_read() {
    for name in [
        "/etc/hostname",
        "../other/frame.png",
        "images/../../frame.png",
    ] {
        let copy = recorded("beside");
        name_files(&copy, |_| Some(name.into()));
        copy.fails(
            DATA,
            &format!(
                "row 0: {WRIST} names the picture {name:?}, which is not in the recording's folder"
            ),
        );
    }
    // A name with the whole path of the folder is one inside of it.
    let copy = recorded("beside");
    let folder = copy.root().to_str().unwrap().to_string();
    name_files(&copy, |_| Some(format!("{folder}/{FIRST}")));
    copy.open().unwrap().frame(7, 10).unwrap();
}

#[test]
fn pictures_that_are_missing() {
    let copy = recorded("beside");
    fs::remove_file(copy.path(FIRST)).unwrap();
    copy.fails(FIRST, "missing");

    let copy = recorded("beside");
    name_files(&copy, |row| (row != 3).then(|| FIRST.into()));
    copy.fails(DATA, "row 3: observation.images.wrist has no picture");

    let copy = recorded("lerobot");
    copy.edit_text(INFO, WRIST, "observation.images.side");
    copy.fails(DATA, "has no column \"observation.images.side\"");

    let copy = recorded("lerobot");
    copy.edit_table(DATA, |rows| {
        let numbers = rows.column_by_name("index").unwrap().clone();
        vec![with_column(rows, WRIST, numbers)]
    });
    copy.fails(
        DATA,
        "observation.images.wrist holds Int64, expected pictures",
    );
}

#[test]
fn a_small_picture_cannot_claim_many_pixels() {
    let copy = recorded("beside");
    copy.edit_text(
        INFO,
        "24,\n                40,",
        "8000,\n                8000,",
    );
    copy.fails(FIRST, "bytes cannot hold 8000 x 8000 pixels");
}

#[test]
fn a_jpeg_picture_of_many_scans_is_refused() {
    let copy = recorded("beside");
    let upright = fs::read(fixtures().join("pictures/odd/upright.jpg")).unwrap();
    let at = upright.windows(2).position(|w| w == [0xff, 0xda]).unwrap();
    let scan = &upright[at..upright.len() - 2];
    let many = [&upright[..at], &scan.repeat(101), &[0xff, 0xd9]].concat();
    fs::write(copy.path(FIRST), many).unwrap();
    copy.fails(FIRST, "has 101 scans, at most 100 are decoded");
}

/// The first picture with one more chunk before its pixels.
fn with_chunk(copy: &Copy, kind: &[u8; 4], content: &[u8]) {
    let mut crc = flate2::Crc::new();
    crc.update(kind);
    crc.update(content);
    let len = (content.len() as u32).to_be_bytes();
    copy.edit(FIRST, |png| {
        // The mark of a PNG file takes 8 bytes, and the chunk of its size 25.
        let (head, rest) = png.split_at(33);
        [head, &len, kind, content, &crc.sum().to_be_bytes(), rest].concat()
    });
}

#[test]
fn chunks_of_a_png_picture_that_are_not_its_pixels() {
    // This text has no name. LeRobot reads the picture.
    let copy = recorded("beside");
    with_chunk(&copy, b"tEXt", b"");
    let dataset = copy.open().unwrap();
    let wanted = read_by_lerobot("lerobot");
    assert_eq!(difference(&dataset, &wanted, &in_order()), (0, 0));

    let copy = recorded("beside");
    with_chunk(&copy, b"acTL", &[0, 0, 0, 2, 0, 0, 0, 0]);
    copy.fails(FIRST, "is an animation");

    let copy = recorded("beside");
    with_chunk(&copy, b"eXIf", &vec![0; 17 << 20]);
    copy.fails(FIRST, "limits are exceeded");
}

/// The recording with its pictures written in another way, each with `end` zeros after its end.
fn rewritten(properties: WriterProperties, end: usize) -> Copy {
    let copy = recorded("lerobot");
    let mut table = None;
    copy.edit_table(DATA, |rows| {
        table = Some(rows.clone());
        vec![rows]
    });
    let rows = table.unwrap();
    let pictures = rows.column_by_name(WRIST).unwrap();
    let pictures = pictures.as_any().downcast_ref::<StructArray>().unwrap();
    let (fields, mut parts, nulls) = pictures.clone().into_parts();
    let at = fields.iter().position(|f| f.name() == "bytes").unwrap();
    let bytes = parts[at].as_any().downcast_ref::<BinaryArray>().unwrap();
    let long: BinaryArray = bytes
        .iter()
        .map(|picture| Some([picture.unwrap(), &vec![0; end]].concat()))
        .collect();
    parts[at] = Arc::new(long) as ArrayRef;
    let rows = with_column(
        rows,
        WRIST,
        Arc::new(StructArray::new(fields, parts, nulls)),
    );
    let file = fs::File::create(copy.path(DATA)).unwrap();
    let mut writer = ArrowWriter::try_new(file, rows.schema(), Some(properties)).unwrap();
    writer.write(&rows).unwrap();
    writer.close().unwrap();
    copy
}

#[test]
fn a_page_of_pictures_that_claims_far_more_than_its_bytes_is_refused() {
    let zstd = || {
        WriterProperties::builder()
            .set_dictionary_enabled(false)
            .set_data_page_size_limit(1 << 30)
            .set_compression(Compression::ZSTD(Default::default()))
            .build()
    };
    // Eight pictures are in one page.
    rewritten(zstd(), 2 << 20).fails(DATA, "are read of a page or file of this size");
    let copy = rewritten(zstd(), 100_000);
    let dataset = copy.open().unwrap();
    let wanted = read_by_lerobot("lerobot");
    assert_eq!(difference(&dataset, &wanted, &in_order()), (0, 0));
}

#[test]
fn pictures_of_which_each_may_repeat_the_one_before_are_refused() {
    // Going to the last picture of a page would build all others first.
    let bytes = ColumnPath::new(vec![WRIST.into(), "bytes".into()]);
    let properties = WriterProperties::builder()
        .set_dictionary_enabled(false)
        .set_column_encoding(bytes, Encoding::DELTA_BYTE_ARRAY)
        .build();
    rewritten(properties, 0).fails(
        DATA,
        "the encoding DELTA_BYTE_ARRAY for pictures; this is not supported",
    );
}
