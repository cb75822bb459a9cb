//! Damaged recordings: each ends in an error that names the file and the cause, never in a panic, and never in an
//! allocation that the damaged file talked the reader into.

use std::alloc::{GlobalAlloc, Layout, System};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::Arc;

use arrow_array::{ArrayRef, Float32Array, Float64Array, RecordBatch};
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use parquet::arrow::ArrowWriter;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tempfile::TempDir;
use zk0_smolvla::dataset::{Dataset, DatasetError, VideoReader};

/// Remembers the largest single allocation of the test process.
struct Watched;
static LARGEST: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call goes to the system's allocator unchanged.
unsafe impl GlobalAlloc for Watched {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        LARGEST.fetch_max(layout.size(), Ordering::Relaxed);
        unsafe { System.alloc(layout) }
    }
    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        LARGEST.fetch_max(layout.size(), Ordering::Relaxed);
        unsafe { System.alloc_zeroed(layout) }
    }
    unsafe fn realloc(&self, ptr: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        LARGEST.fetch_max(size, Ordering::Relaxed);
        unsafe { System.realloc(ptr, layout, size) }
    }
    unsafe fn dealloc(&self, ptr: *mut u8, layout: Layout) {
        unsafe { System.dealloc(ptr, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Watched = Watched;

const INFO: &str = "meta/info.json";
const STATS: &str = "meta/stats.json";
const DATA: &str = "data/chunk-000/file-000.parquet";
const TOP: &str = "videos/observation.images.top/chunk-000/file-000.mp4";

fn recording(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../tests/fixtures/datasets")
        .join(name)
}

/// A copy of a good recording to damage.
struct Copy(TempDir);

impl Copy {
    fn new() -> Self {
        fn copy(from: &Path, to: &Path) {
            fs::create_dir_all(to).unwrap();
            for entry in fs::read_dir(from).unwrap() {
                let entry = entry.unwrap();
                let to = to.join(entry.file_name());
                if entry.file_type().unwrap().is_dir() {
                    copy(&entry.path(), &to);
                } else {
                    fs::write(to, fs::read(entry.path()).unwrap()).unwrap();
                }
            }
        }
        let dir = tempfile::tempdir().unwrap();
        copy(&recording("so100_pickplace"), dir.path());
        Self(dir)
    }

    fn path(&self, file: &str) -> PathBuf {
        self.0.path().join(file)
    }

    fn edit(&self, file: &str, change: impl FnOnce(Vec<u8>) -> Vec<u8>) {
        let path = self.path(file);
        fs::write(&path, change(fs::read(&path).unwrap())).unwrap();
    }

    fn edit_text(&self, file: &str, from: &str, to: &str) {
        self.edit(file, |bytes| {
            let text = String::from_utf8(bytes).unwrap();
            assert!(text.contains(from), "{from} is not in {file}");
            text.replacen(from, to, 1).into_bytes()
        });
    }

    /// Rewrites the data file's table.
    fn edit_rows(&self, change: impl Fn(RecordBatch) -> RecordBatch) {
        let path = self.path(DATA);
        let reader = ParquetRecordBatchReaderBuilder::try_new(fs::File::open(&path).unwrap())
            .unwrap()
            .with_batch_size(1 << 20)
            .build()
            .unwrap();
        let batches: Vec<RecordBatch> = reader.map(|b| change(b.unwrap())).collect();
        let file = fs::File::create(&path).unwrap();
        let mut writer = ArrowWriter::try_new(file, batches[0].schema(), None).unwrap();
        for batch in &batches {
            writer.write(batch).unwrap();
        }
        writer.close().unwrap();
    }

    fn open(&self) -> Result<Dataset, DatasetError> {
        Dataset::open(self.0.path())
    }

    /// The error of opening and reading everything.
    fn error(&self) -> DatasetError {
        let dataset = match self.open() {
            Ok(dataset) => dataset,
            Err(e) => return e,
        };
        let mut frames = dataset.frames(10).unwrap();
        frames
            .find_map(Result::err)
            .expect("the damage went unnoticed")
    }

    /// Expects an error that names `file` and says `cause`.
    #[track_caller]
    fn fails(&self, file: &str, cause: &str) {
        let message = self.error().to_string();
        let path = self.path(file);
        assert!(
            message.contains(path.to_str().unwrap()) && message.contains(cause),
            "expected {file} and {cause:?} in: {message}"
        );
    }
}

fn with_column(batch: RecordBatch, name: &str, column: ArrayRef) -> RecordBatch {
    let schema = batch.schema();
    let columns = schema.fields().iter().enumerate().map(|(i, field)| {
        let replaced = field.name() == name;
        let column = if replaced { &column } else { batch.column(i) };
        (field.name().clone(), column.clone())
    });
    RecordBatch::try_from_iter(columns.collect::<Vec<_>>()).unwrap()
}

#[test]
fn folder_and_files_that_are_not_there() {
    let error = Dataset::open(recording("nowhere")).unwrap_err().to_string();
    assert!(error.contains("nowhere: no such folder"), "{error}");

    let files = [
        INFO,
        STATS,
        "meta/tasks.parquet",
        "meta/episodes",
        DATA,
        TOP,
    ];
    for file in files {
        let copy = Copy::new();
        let path = copy.path(file);
        if path.is_dir() {
            fs::remove_dir_all(path).unwrap();
        } else {
            fs::remove_file(path).unwrap();
        }
        assert!(
            matches!(copy.open(), Err(DatasetError::MissingFile { path }) if path == copy.path(file)),
            "{file}"
        );
    }
}

#[test]
fn broken_info() {
    let cases = [
        ("\"fps\"", "fps", "not the JSON"),
        ("\"fps\": 30", "\"fps\": 0", "fps is 0"),
        ("\"fps\": 30", "\"fps\": -1", "invalid value"),
        ("\"fps\": 30", "\"frames\": 30", "missing field `fps`"),
        ("codebase_version", "version", "no codebase_version"),
        (
            "\"total_frames\": 245",
            "\"total_frames\": 1000000000000",
            "total_frames is 1000000000000",
        ),
        (
            "\"total_frames\": 245",
            "\"total_frames\": 0",
            "total_frames is 0",
        ),
        (
            "\"total_episodes\": 6",
            "\"total_episodes\": 99999999999",
            "total_episodes is 99999999999",
        ),
        (
            "\"total_tasks\": 1",
            "\"total_tasks\": 99999999999",
            "total_tasks is 99999999999",
        ),
        ("\"action\":", "\"motion\":", "no feature action"),
        (
            "\"observation.state\":",
            "\"observation.stat\":",
            "no feature observation.state",
        ),
        ("\"float32\"", "\"float64\"", "action is float64"),
        (
            "                6",
            "                600000000",
            "action has shape [600000000]",
        ),
        (
            "                96",
            "                960000000",
            "shape [960000000, 128, 3]",
        ),
        ("\"video\"", "\"image\"", "stores single images"),
        ("data/chunk-{", "../data/chunk-{", "path template"),
        (
            "{file_index:03d}.parquet",
            "{other}.parquet",
            "path template",
        ),
        ("videos/{video_key}", "/{video_key}", "path template"),
    ];
    for (from, to, cause) in cases {
        let copy = Copy::new();
        copy.edit_text(INFO, from, to);
        copy.fails(INFO, cause);
    }
    let copy = Copy::new();
    copy.edit(INFO, |_| vec![b' '; 17 << 20]);
    copy.fails(INFO, "larger than");
}

#[test]
fn counts_that_the_files_do_not_hold() {
    let copy = Copy::new();
    copy.edit_text(INFO, "\"total_frames\": 245", "\"total_frames\": 246");
    copy.fails("meta/episodes", "meta/info.json declares 6 with 246");
    let copy = Copy::new();
    copy.edit_text(INFO, "\"total_episodes\": 6", "\"total_episodes\": 5");
    copy.fails(
        "meta/episodes/chunk-000/file-000.parquet",
        "expected episode 5 of 5",
    );
    let copy = Copy::new();
    copy.edit_text(INFO, "\"total_tasks\": 1", "\"total_tasks\": 2");
    copy.fails("meta/tasks.parquet", "does not name all 2 tasks");
}

#[test]
fn an_older_format_is_told_how_to_convert() {
    let error = Dataset::open(recording("so100_pickplace_v21")).unwrap_err();
    assert!(
        matches!(&error, DatasetError::Version { found, .. } if found == "v2.1"),
        "{error}"
    );
    assert!(error.to_string().contains("convert_dataset_v21_to_v30"));
}

#[test]
fn broken_stats() {
    let copy = Copy::new();
    copy.edit(STATS, |bytes| bytes[..bytes.len() / 2].to_vec());
    copy.fails(STATS, "not the JSON");

    let damage = |change: fn(&mut serde_json::Value), cause| {
        let copy = Copy::new();
        copy.edit(STATS, |bytes| {
            let mut stats = serde_json::from_slice(&bytes).unwrap();
            change(&mut stats);
            serde_json::to_vec(&stats).unwrap()
        });
        copy.fails(STATS, cause);
    };
    damage(
        |s| s["action"]["std"][2] = (-1.0).into(),
        "action: a mean or standard deviation",
    );
    damage(
        |s| s["action"]["std"][2] = 1e300.into(),
        "action: a mean or standard deviation",
    );
    damage(
        |s| s["action"]["mean"] = vec![0.0; 5].into(),
        "action: 5 means",
    );
    damage(|s| s["observation.state"] = 1.into(), "observation.state: ");
    damage(
        |s| drop(s.as_object_mut().unwrap().remove("action")),
        "no statistics of action",
    );
}

#[test]
fn rows_that_do_not_fit() {
    let copy = Copy::new();
    copy.edit_rows(|rows| rows.slice(0, 235));
    copy.fails(DATA, "ends after 235 frames, meta/info.json declares 245");

    let copy = Copy::new();
    copy.edit_rows(|rows| rows.slice(1, 244));
    copy.fails(DATA, "index 1 found where meta/episodes expects index 0");

    let copy = Copy::new();
    copy.edit_rows(|rows| {
        let times = rows.column_by_name("timestamp").unwrap();
        let times = arrow_array::cast::as_primitive_array::<arrow_array::types::Float32Type>(times);
        let doubles: Float64Array = times.iter().map(|t| t.map(f64::from)).collect();
        with_column(rows, "timestamp", Arc::new(doubles))
    });
    copy.fails(DATA, "column timestamp holds Float64, expected Float32");

    let copy = Copy::new();
    copy.edit_rows(|rows| {
        let ones = Float32Array::from(vec![1.0; rows.num_rows()]);
        with_column(rows, "action", Arc::new(ones))
    });
    copy.fails(
        DATA,
        "column action holds Float32, expected lists of float32",
    );

    let copy = Copy::new();
    copy.edit_rows(|rows| {
        let gaps: Float32Array = (0..rows.num_rows())
            .map(|i| (i != 9).then_some(0.0))
            .collect();
        with_column(rows, "timestamp", Arc::new(gaps))
    });
    copy.fails(DATA, "column timestamp has empty cells");

    let copy = Copy::new();
    copy.edit_rows(|rows| {
        let at = rows.schema().index_of("task_index").unwrap();
        let mut rows = rows;
        rows.remove_column(at);
        rows
    });
    copy.fails(DATA, "has no column task_index");

    let copy = Copy::new();
    copy.edit_text(INFO, "                6", "                7");
    let error = copy.error().to_string();
    assert!(error.contains("7 dimensions"), "{error}");
}

#[test]
fn values_that_are_not_finite() {
    use arrow_array::{cast::AsArray, types::Float32Type, Array, FixedSizeListArray};
    let copy = Copy::new();
    copy.edit_rows(|rows| {
        let states = rows
            .column_by_name("observation.state")
            .unwrap()
            .as_fixed_size_list();
        let mut values = states
            .values()
            .as_primitive::<Float32Type>()
            .values()
            .to_vec();
        values[6 * 50 + 3] = f32::NAN;
        let arrow_schema::DataType::FixedSizeList(field, dim) = states.data_type() else {
            panic!()
        };
        let values = Arc::new(Float32Array::from(values));
        let states = FixedSizeListArray::new(field.clone(), *dim, values, None);
        with_column(rows, "observation.state", Arc::new(states))
    });
    copy.fails(DATA, "row 50: observation.state holds NaN in dimension 3");
}

#[test]
fn frames_stored_twice_are_named() {
    let error = Dataset::open(recording("so100_stacking_doubled")).unwrap_err();
    assert!(
        matches!(
            error,
            DatasetError::RepeatedFrame {
                row: 249,
                index: 0,
                episode: 0,
                frame: 0,
                ..
            }
        ),
        "{error}"
    );
}

#[test]
fn timestamps_off_the_frame_grid_are_named() {
    let error = Dataset::open(recording("so100_pickplace_bad_timestamps")).unwrap_err();
    assert!(
        matches!(
            error,
            DatasetError::Timestamp {
                episode: 2,
                frame: 10,
                ..
            }
        ),
        "{error}"
    );
}

#[test]
fn videos_that_are_cut_or_no_videos() {
    let whole = fs::read(recording("so100_pickplace").join(TOP))
        .unwrap()
        .len();
    for len in [0, 7, 20, 1000, whole / 2, whole - 1] {
        let copy = Copy::new();
        copy.edit(TOP, |bytes| bytes[..len].to_vec());
        copy.fails(TOP, "cut off");
    }
    let copy = Copy::new();
    copy.edit(TOP, |bytes| bytes.iter().map(|b| b ^ 0x5a).collect());
    copy.fails(TOP, "not an mp4");

    let copy = Copy::new();
    copy.edit(TOP, |mut bytes| {
        let at = bytes.windows(4).position(|w| w == b"av01").unwrap();
        // The first is a brand in ftyp; the sample description is the next one.
        let at = at
            + 4
            + bytes[at + 4..]
                .windows(4)
                .position(|w| w == b"av01")
                .unwrap();
        bytes[at..at + 4].copy_from_slice(b"avc1");
        bytes
    });
    copy.fails(TOP, "codec \"avc1\", only AV1");

    let copy = Copy::new();
    copy.edit_text(INFO, "                96", "                97");
    copy.fails(
        TOP,
        "96 x 128 (height x width), meta/info.json says 97 x 128",
    );
}

/// Overwrites bytes of the `nth` box of this kind, from `skip` bytes after its name on.
fn patch(bytes: &mut [u8], kind: &[u8; 4], nth: usize, skip: usize, value: &[u8]) {
    let mut named = bytes.windows(4).enumerate().filter(|(_, w)| w == kind);
    let at = named.nth(nth).unwrap().0 + 4 + skip;
    bytes[at..at + value.len()].copy_from_slice(value);
}

#[test]
fn mp4_tables_that_contradict_themselves() {
    let big = 0x7fff_ffff_u32.to_be_bytes();
    // Box, bytes into it, what is written there, what the reader says.
    let cases: [(&[u8; 4], usize, &[u8], &str); 11] = [
        (b"stss", 8, &big, "key frame 2147483647 does not exist"),
        (b"stss", 8, &[0; 4], "key frame 0 does not exist"),
        (b"stss", 8, &[0, 0, 0, 2], "does not begin with a key frame"),
        (b"stss", 4, &big, "a box ends too early"),
        (b"stts", 12, &[0; 4], "frame 1 is not shown after frame 0"),
        (b"stts", 8, &[0, 0, 0, 1], "a box ends too early"),
        (b"mdhd", 12, &[0; 4], "timescale of 0"),
        (b"stsz", 8, &big, "frame count 2147483647 does not fit"),
        (
            b"stsc",
            12,
            &[0, 0, 0, 1],
            "declares 245 frames and places 1",
        ),
        (
            b"stco",
            8,
            &big,
            "from byte 2147483647) is not within the file",
        ),
        (b"hdlr", 8, b"soun", "has no video track"),
    ];
    for (kind, skip, value, cause) in cases {
        let copy = Copy::new();
        copy.edit(TOP, |mut bytes| {
            patch(&mut bytes, kind, 0, skip, value);
            bytes
        });
        copy.fails(TOP, cause);
    }
    for (kind, name, cause) in [
        (b"udta", b"mvex", "fragmented"),
        (b"moov", b"moof", "fragmented"),
        (b"stsc", b"free", "has no stsc box"),
        (b"stco", b"free", "has no chunk offsets"),
    ] {
        let copy = Copy::new();
        copy.edit(TOP, |bytes| {
            let at = bytes.windows(4).position(|w| w == kind).unwrap();
            [&bytes[..at], name, &bytes[at + 4..]].concat()
        });
        copy.fails(TOP, cause);
    }
}

#[test]
fn a_bitstream_of_another_size_than_the_container_says() {
    // The second "av01" is the sample description; width and height are 24 bytes into it.
    let claim = |height: u8, width: u8| {
        let copy = Copy::new();
        copy.edit(TOP, |mut bytes| {
            patch(&mut bytes, b"av01", 1, 24, &[0, width, 0, height]);
            bytes
        });
        let size = |h, w| format!("[\n                {h},\n                {w},");
        copy.edit_text(INFO, &size(96, 128), &size(height, width));
        copy
    };
    claim(48, 64).fails(TOP, "video frame 0 does not decode"); // refused before it is decoded
    claim(128, 96).fails(
        TOP,
        "video frame 0 is 96 x 128 (height x width), expected 128 x 96",
    );
}

#[test]
fn a_video_that_does_not_decode_names_the_frame() {
    // The container stays as it was; what it holds is noise.
    let copy = Copy::new();
    copy.edit(TOP, |mut bytes| {
        let mdat = bytes.windows(4).position(|w| w == b"mdat").unwrap() + 4;
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        rng.fill(&mut bytes[mdat..]);
        bytes
    });
    copy.fails(TOP, "video frame 0 does not decode");
    let error = copy.error().to_string();
    assert!(
        error.starts_with("episode 0 frame 0, camera observation.images.top: "),
        "{error}"
    );
}

#[test]
fn a_video_with_too_few_frames_names_the_first_that_is_missing() {
    let copy = Copy::new();
    let short =
        recording("so100_sorting").join("videos/observation.images.top/chunk-000/file-001.mp4");
    copy.edit(TOP, |_| fs::read(short).unwrap());
    copy.fails(TOP, "its 75 frames end at 2.466667 s");
    let error = copy.error().to_string();
    assert!(error.starts_with("episode 1 frame 34, "), "{error}"); // frame 75, episode 0 has 41
}

#[test]
fn parquet_files_cut_anywhere() {
    for file in [
        DATA,
        "meta/tasks.parquet",
        "meta/episodes/chunk-000/file-000.parquet",
    ] {
        let copy = Copy::new();
        let whole = fs::read(copy.path(file)).unwrap();
        for part in 0..20 {
            copy.edit(file, |_| whole[..whole.len() * part / 20].to_vec());
            copy.fails(file, "damaged parquet file");
        }
    }
}

/// Found by random damage: with this byte changed the parquet crate (60.1) panics.
#[test]
fn a_panic_of_the_parquet_crate_becomes_an_error() {
    let copy = Copy::new();
    copy.edit(DATA, |mut bytes| {
        bytes[959] = 0;
        bytes
    });
    copy.fails(DATA, "damaged parquet file: ");
}

/// Random damage: a few bytes changed, a stretch overwritten, or the tail lost.
fn damaged(bytes: &[u8], rng: &mut ChaCha8Rng) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    // Half of the damage goes to the first 2 KiB, where the mp4's index is, or the last, where parquet's is.
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
        // Lengths and counts are 32-bit: make one huge.
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

/// What the largest allocation may be: decoder state and buffers, whatever a file claims.
const ENOUGH: usize = 64 << 20;

#[test]
fn random_damage_to_a_video_never_panics() {
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
                // A few frames each; all of them would take minutes.
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
    assert!(LARGEST.load(Ordering::Relaxed) < ENOUGH);
}

#[test]
fn random_damage_to_a_parquet_file_never_panics() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    for file in [
        DATA,
        "meta/tasks.parquet",
        "meta/episodes/chunk-000/file-000.parquet",
    ] {
        let copy = Copy::new();
        let whole = fs::read(copy.path(file)).unwrap();
        let mut refused = 0;
        for _ in 0..500 {
            copy.edit(file, |_| damaged(&whole, &mut rng));
            refused += usize::from(copy.open().is_err());
        }
        assert!(refused > 100, "{file}: {refused}");
    }
    assert!(LARGEST.load(Ordering::Relaxed) < ENOUGH);
}
