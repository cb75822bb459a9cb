//! Opens a parquet file, and calls the parquet crate.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::panic::{catch_unwind, AssertUnwindSafe};
use std::path::Path;

use parquet::arrow::arrow_reader::{
    ArrowReaderMetadata, ArrowReaderOptions, ParquetRecordBatchReaderBuilder,
};
use parquet::arrow::ProjectionMask;

use crate::dataset::tables::fault::ParquetFault;
use crate::dataset::DatasetError;

/// Opens a parquet file without Arrow's additions (views, dictionaries, fixed lengths), which only describe the writer's memory.
pub(super) fn open(path: &Path) -> Result<(File, ArrowReaderMetadata), DatasetError> {
    let file = File::open(path).map_err(|e| DatasetError::io(path, e))?;
    if is_encrypted(&file) {
        let fault = ParquetFault::NotSupported("the file is encrypted".into());
        return Err(DatasetError::parquet(path, fault.to_string()));
    }
    let options = ArrowReaderOptions::new().with_skip_arrow_metadata(true);
    let metadata = guarded(path, || ArrowReaderMetadata::load(&file, options))?;
    Ok((file, metadata))
}

/// A reader of an open file; rows and columns are still to be chosen.
pub(super) fn reader(
    path: &Path,
    file: &File,
    metadata: ArrowReaderMetadata,
) -> Result<ParquetRecordBatchReaderBuilder<File>, DatasetError> {
    let file = file.try_clone().map_err(|e| DatasetError::io(path, e))?;
    Ok(ParquetRecordBatchReaderBuilder::new_with_metadata(
        file, metadata,
    ))
}

pub(super) fn projection(
    path: &Path,
    metadata: &ArrowReaderMetadata,
    columns: &[&str],
) -> Result<ProjectionMask, DatasetError> {
    let schema = metadata.parquet_schema();
    let fields = schema.root_schema().get_fields();
    let place = |name: &&str| {
        fields
            .iter()
            .position(|f| f.name() == *name)
            .ok_or_else(|| DatasetError::parquet(path, format!("has no column {name:?}")))
    };
    let roots: Vec<usize> = columns.iter().map(place).collect::<Result<_, _>>()?;
    Ok(ProjectionMask::roots(schema, roots))
}

fn is_encrypted(mut file: &File) -> bool {
    let mut magic = [0; 4];
    let read = file
        .seek(SeekFrom::End(-4))
        .and_then(|_| file.read_exact(&mut magic));
    read.is_ok() && magic == *b"PARE"
}

/// Runs a step of the parquet crate, which panics on some damaged files.
pub(super) fn guarded<T, E: Into<ParquetFault>>(
    path: &Path,
    step: impl FnOnce() -> Result<T, E>,
) -> Result<T, DatasetError> {
    let fault = match catch_unwind(AssertUnwindSafe(step)) {
        Ok(Ok(value)) => return Ok(value),
        Ok(Err(e)) => e.into(),
        Err(_) => ParquetFault::Damaged("its pages contradict each other".into()),
    };
    Err(DatasetError::parquet(path, fault.to_string()))
}
