//! Tables that other writers than LeRobot's made, and what LeRobot 0.6.1 makes of them.

use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;
use std::sync::Arc;

use zk0_lerobot::dataset::{Dataset, Frame};
use zk0_testkit::recordings::{fixtures, open, with_column, Copy, DATA, INFO, STATS};

const BASE: &str = "so100_sorting_two";
const TASKS: &str = "meta/tasks.parquet";

/// The recording with the tables of one writer in place of its own.
fn written(writer: &str) -> Copy {
    let copy = Copy::of(BASE);
    let folder = fixtures().join("tables").join(writer);
    if folder.join("data").exists() && !folder.join(DATA).exists() {
        fs::remove_dir_all(copy.path("data")).unwrap();
    }
    copy.add(&folder);
    copy
}

fn writers() -> Vec<String> {
    let entries = fs::read_dir(fixtures().join("tables")).unwrap();
    let folders = entries.map(|e| e.unwrap().path()).filter(|p| p.is_dir());
    let name = |p: PathBuf| p.file_name().unwrap().to_str().unwrap().to_string();
    folders.map(name).collect()
}

fn motion(dataset: &Dataset) -> Vec<Frame> {
    let loader = dataset.loader(10).unwrap();
    (0..dataset.len())
        .map(|i| loader.motion(i).unwrap())
        .collect()
}

#[test]
fn tables_of_any_writer_say_the_same() {
    let text = fs::read_to_string(fixtures().join("tables/lerobot.json")).unwrap();
    let lerobot: BTreeMap<String, String> = serde_json::from_str(&text).unwrap();
    assert_eq!(lerobot.len(), writers().len());
    let base = open(BASE);
    let wanted = motion(&base);
    let (mut same, mut better) = (0, 0);
    for writer in writers().iter().filter(|w| !w.starts_with("refused_")) {
        let copy = written(writer);
        let dataset = copy.open().unwrap_or_else(|e| panic!("{writer}: {e}"));
        assert!(motion(&dataset) == wanted, "{writer}");
        assert_eq!(dataset.tasks(), base.tasks(), "{writer}");
        assert!(dataset.repairs().is_empty(), "{writer}");
        let at = dataset.len() - 1;
        assert!(
            dataset.frame(at, 10).unwrap() == base.frame(at, 10).unwrap(),
            "{writer}"
        );
        // LeRobot takes the tasks from the index of pandas. Other writers drop it, and LeRobot gives row numbers or bytes as the task.
        match lerobot[writer].as_str() {
            "the same" => same += 1,
            _ => better += 1,
        }
    }
    assert!(same > 30 && better < 12, "{same} {better}");
}

#[test]
fn rows_in_another_order_are_refused() {
    // LeRobot 0.6.1 hands out other frames without a word.
    written("refused_other_order").fails(
        DATA,
        "row 10 (episode 0): index 11 found where the episodes' metadata expects index 10",
    );
}

#[test]
fn numbers_that_are_not_whole_are_named() {
    written("refused_half_index").fails(DATA, "column index holds 0.5, expected whole numbers");
}

#[test]
fn what_is_not_supported_is_not_called_damaged() {
    let not_damaged = |copy: &Copy, cause: &str| {
        copy.fails(DATA, cause);
        let error = copy.error().to_string();
        assert!(!error.contains("damaged"), "{error}");
        assert!(error.contains("not supported"), "{error}");
    };
    not_damaged(&written("refused_encrypted"), "the file is encrypted");

    // The number of the codec follows the name of the column in the footer. This file claims LZO in place of snappy.
    let copy = Copy::of(BASE);
    copy.edit(DATA, |mut bytes| {
        let snappy = b"\x09timestamp\x15\x02";
        let places = bytes.windows(snappy.len()).enumerate();
        let places: Vec<usize> = places
            .filter(|(_, w)| w == snappy)
            .map(|(at, _)| at)
            .collect();
        assert!(!places.is_empty());
        for at in places {
            bytes[at + snappy.len() - 1] = 6;
        }
        bytes
    });
    not_damaged(&copy, "column timestamp: LZO compression");

    // 100 MB are more than a small file may hold, and may be right for another one.
    let copy = Copy::of(BASE);
    copy.edit(DATA, |mut bytes| {
        // The type and the sizes of the first page, and the same size in six bytes as in two.
        assert_eq!(bytes[4..7], [0x15, 0x04, 0x15]);
        let huge = [0x80, 0x84, 0xaf, 0x5f];
        bytes.splice(7..9, huge);
        bytes
    });
    let error = copy.error().to_string();
    assert!(
        error.contains("at most 8388608 are read of a page or file of this size"),
        "{error}"
    );
    assert!(!error.contains("damaged"), "{error}");
}

#[test]
fn a_page_that_holds_more_than_it_claims_is_refused() {
    use std::io::Write;
    let copy = written("pyarrow_gzip_pages1");
    copy.edit(DATA, |mut bytes| {
        // The last page in gzip before the footer becomes as many bytes that hold a hundred times as much.
        let pages: Vec<usize> = (0..bytes.len() - 3)
            .filter(|&at| bytes[at..at + 3] == [0x1f, 0x8b, 8])
            .collect();
        let sizes = pages.windows(2).map(|pair| pair[1] - pair[0]);
        let (size, at) = sizes.zip(pages.iter().copied()).max().unwrap();
        let mut zeros = flate2::GzBuilder::new()
            .comment(vec![b'.'; size / 2])
            .write(Vec::new(), flate2::Compression::best());
        zeros.write_all(&vec![0; size * 100]).unwrap();
        let zeros = zeros.finish().unwrap();
        assert!(zeros.len() < size);
        // What follows the first member of the stream is none, and is not reached.
        bytes[at..at + zeros.len()].copy_from_slice(&zeros);
        bytes
    });
    copy.fails(DATA, "bytes and holds more");
}

#[test]
fn statistics_that_are_not_finite() {
    // Python writes NaN into JSON. LeRobot reads it; where it is not used, training does not notice.
    let copy = Copy::of(BASE);
    copy.edit(STATS, |bytes| {
        let mut stats: serde_json::Value = serde_json::from_slice(&bytes).unwrap();
        stats["observation.images.top"]["max"][0][0][0] = "<NaN>".into();
        stats["next.\"NaN\""] = serde_json::json!({"mean": ["<-Infinity>"], "std": ["<Infinity>"]});
        let text = stats.to_string().replace("\"<", "").replace(">\"", "");
        assert!(text.contains("NaN") && text.contains("-Infinity"));
        text.into_bytes()
    });
    assert_eq!(copy.open().unwrap().stats(), open(BASE).stats());

    // LeRobot normalises with NaN, and the loss is NaN from the first step on.
    for feature in ["action", "observation.state"] {
        for (moment, named) in [("mean", "mean"), ("std", "standard deviation")] {
            let copy = Copy::of(BASE);
            copy.edit(STATS, |bytes| {
                let mut stats: serde_json::Value = serde_json::from_slice(&bytes).unwrap();
                stats[feature][moment][2] = "<NaN>".into();
                stats.to_string().replace("\"<NaN>\"", "NaN").into_bytes()
            });
            copy.fails(STATS, &format!("{feature}: {named} 2 is NaN"));
        }
    }
}

#[test]
fn whole_numbers_that_python_wrote_as_floats() {
    let copy = Copy::of(BASE);
    copy.edit_text(INFO, "\"fps\": 30,", "\"fps\": 30.0,");
    copy.edit_text(INFO, "\"total_frames\": 90,", "\"total_frames\": 90.0,");
    let dataset = copy.open().unwrap();
    assert_eq!((dataset.fps(), dataset.len()), (30, 90));
    let copy = Copy::of(BASE);
    copy.edit_text(INFO, "\"fps\": 30,", "\"fps\": 29.97,");
    copy.fails(INFO, "29.97 where a whole number is expected");
}

#[test]
fn the_index_of_pandas_is_the_column_of_tasks() {
    // fastparquet calls it "index", and nothing but pandas' notes tells.
    let copy = written("fastparquet_snappy");
    let bytes = fs::read(copy.path(TASKS)).unwrap();
    let index = b"\"index_columns\": [\"index\"]";
    assert!(bytes.windows(index.len()).any(|w| w == index));
    copy.edit(TASKS, |bytes| {
        let at = bytes.windows(index.len()).position(|w| w == index).unwrap();
        [
            &bytes[..at],
            b"\"index_columns\": [\"other\"]",
            &bytes[at + index.len()..],
        ]
        .concat()
    });
    copy.fails(TASKS, "has no column of task strings");
}

/// duckdb makes one page of 122880 rows.
#[test]
fn a_page_of_ten_megabytes_is_read() {
    use arrow_array::types::Float32Type;
    use arrow_array::ListArray;
    use parquet::arrow::ArrowWriter;
    use parquet::file::properties::WriterProperties;
    use parquet::file::reader::{FileReader, SerializedFileReader};

    const DIM: usize = 4096;
    let copy = Copy::default();
    copy.edit_text(INFO, "                6", "                4096");
    copy.edit(STATS, |bytes| {
        let mut stats: serde_json::Value = serde_json::from_slice(&bytes).unwrap();
        for moment in ["mean", "std"] {
            stats["action"][moment] = vec![1.0; DIM].into();
        }
        stats.to_string().into_bytes()
    });
    let mut rows = None;
    copy.edit_table(DATA, |table| {
        rows = Some(table.clone());
        vec![table]
    });
    let rows = rows.unwrap();
    let value = |row: usize, dim: usize| ((row * DIM + dim) as f32).sin();
    let actions = (0..rows.num_rows()).map(|row| Some((0..DIM).map(move |d| Some(value(row, d)))));
    let actions = ListArray::from_iter_primitive::<Float32Type, _, _>(actions);
    let rows = with_column(rows, "action", Arc::new(actions));
    let properties = WriterProperties::builder()
        .set_dictionary_enabled(false)
        .set_data_page_size_limit(1 << 30)
        .set_data_page_row_count_limit(usize::MAX)
        .set_write_batch_size(1 << 22)
        .build();
    let file = fs::File::create(copy.path(DATA)).unwrap();
    let mut writer = ArrowWriter::try_new(file, rows.schema(), Some(properties)).unwrap();
    // Three times the same rows, which are read once.
    (0..3).for_each(|_| writer.write(&rows).unwrap());
    writer.close().unwrap();

    let reader = SerializedFileReader::new(fs::File::open(copy.path(DATA)).unwrap()).unwrap();
    let group = reader.get_row_group(0).unwrap();
    let page = group.get_column_page_reader(0).unwrap().get_next_page();
    assert!(page.unwrap().unwrap().buffer().len() > 10_000_000);
    let dataset = copy.open().unwrap();
    assert_eq!(dataset.len(), 245);
    assert_eq!(dataset.action(7).unwrap()[9], value(7, 9));
}
