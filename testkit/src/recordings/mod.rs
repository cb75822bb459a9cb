//! The fixtures' recordings, and damaged copies.

pub mod mp4_writer;

use std::fs;
use std::path::{Path, PathBuf};

use arrow_array::{ArrayRef, RecordBatch};
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use parquet::arrow::ArrowWriter;
use tempfile::TempDir;
use zk0_lerobot::dataset::{Dataset, DatasetError, Frame};

/// A v3.0 recording's description.
pub const INFO: &str = "meta/info.json";
/// The statistics.
pub const STATS: &str = "meta/stats.json";
/// The rows.
pub const DATA: &str = "data/chunk-000/file-000.parquet";
/// One camera's video.
pub const TOP: &str = "videos/observation.images.top/chunk-000/file-000.mp4";

/// The folder of fixtures.
pub fn fixtures() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/fixtures")
}

/// A committed recording.
pub fn recording(name: &str) -> PathBuf {
    fixtures().join("datasets").join(name)
}

/// Opens such a recording.
pub fn open(name: &str) -> Dataset {
    Dataset::open(recording(name)).unwrap()
}

/// Frames in order, up to the first error.
pub fn frames(
    dataset: &Dataset,
    chunk: usize,
) -> impl Iterator<Item = Result<Frame, DatasetError>> + '_ {
    let (mut loader, mut failed) = (dataset.loader(chunk).unwrap(), false);
    (0..dataset.len()).map_while(move |index| {
        let frame = (!failed).then(|| loader.frame(index))?;
        failed = frame.is_err();
        Some(frame)
    })
}

/// A copy to damage.
pub struct Copy(TempDir);

impl Default for Copy {
    fn default() -> Self {
        Self::of("so100_pickplace")
    }
}

impl Copy {
    /// Without files.
    pub fn empty() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    /// Copies a recording.
    pub fn of(name: &str) -> Self {
        let copy = Self::empty();
        copy.add(&recording(name));
        copy
    }

    /// Adds or replaces files.
    pub fn add(&self, folder: &Path) {
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
        copy(folder, self.root());
    }

    /// The folder.
    pub fn root(&self) -> &Path {
        self.0.path()
    }

    /// A file's path.
    pub fn path(&self, file: &str) -> PathBuf {
        self.0.path().join(file)
    }

    /// Changes a file's bytes.
    pub fn edit(&self, file: &str, change: impl FnOnce(Vec<u8>) -> Vec<u8>) {
        let path = self.path(file);
        fs::write(&path, change(fs::read(&path).unwrap())).unwrap();
    }

    /// Replaces a text.
    pub fn edit_text(&self, file: &str, from: &str, to: &str) {
        self.edit(file, |bytes| {
            let text = String::from_utf8(bytes).unwrap();
            assert!(text.contains(from), "{from} is not in {file}");
            text.replacen(from, to, 1).into_bytes()
        });
    }

    /// Rewrites a parquet file. `change` gets all rows in one batch.
    pub fn edit_table(&self, file: &str, change: impl FnOnce(RecordBatch) -> Vec<RecordBatch>) {
        let path = self.path(file);
        let reader = ParquetRecordBatchReaderBuilder::try_new(fs::File::open(&path).unwrap())
            .unwrap()
            .with_batch_size(1 << 20)
            .build()
            .unwrap();
        let whole: Vec<RecordBatch> = reader.map(Result::unwrap).collect();
        let [whole] = &whole[..] else {
            panic!("{file} has several batches")
        };
        let batches = change(whole.clone());
        let file = fs::File::create(&path).unwrap();
        let mut writer = ArrowWriter::try_new(file, batches[0].schema(), None).unwrap();
        for batch in &batches {
            writer.write(batch).unwrap();
        }
        writer.close().unwrap();
    }

    /// Rewrites the rows.
    pub fn edit_rows(&self, change: impl FnOnce(RecordBatch) -> RecordBatch) {
        self.edit_table(DATA, |rows| vec![change(rows)]);
    }

    /// Opens the copy.
    pub fn open(&self) -> Result<Dataset, DatasetError> {
        Dataset::open(self.0.path())
    }

    /// The error of opening and reading all.
    pub fn error(&self) -> DatasetError {
        let dataset = match self.open() {
            Ok(dataset) => dataset,
            Err(e) => return e,
        };
        let mut frames = frames(&dataset, 10);
        frames
            .find_map(Result::err)
            .expect("the damage went unnoticed")
    }

    /// Expects an error that names both.
    #[track_caller]
    pub fn fails(&self, file: &str, cause: &str) {
        let message = self.error().to_string();
        let path = self.path(file);
        assert!(
            message.contains(path.to_str().unwrap()) && message.contains(cause),
            "expected {file} and {cause:?} in: {message}"
        );
    }
}

/// Replaces a column.
pub fn with_column(batch: RecordBatch, name: &str, column: ArrayRef) -> RecordBatch {
    let schema = batch.schema();
    let columns = schema.fields().iter().enumerate().map(|(i, field)| {
        let replaced = field.name() == name;
        let column = if replaced { &column } else { batch.column(i) };
        (field.name().clone(), column.clone())
    });
    RecordBatch::try_from_iter(columns.collect::<Vec<_>>()).unwrap()
}

/// Overwrites the `nth` box of this kind, from `skip` bytes after its name.
pub fn patch(bytes: &mut [u8], kind: &[u8; 4], nth: usize, skip: usize, value: &[u8]) {
    let mut named = bytes.windows(4).enumerate().filter(|(_, w)| w == kind);
    let at = named.nth(nth).unwrap().0 + 4 + skip;
    bytes[at..at + value.len()].copy_from_slice(value);
}
