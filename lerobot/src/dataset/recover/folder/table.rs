//! How tables are written.

use std::collections::HashMap;
use std::fs::File;
use std::io;
use std::path::Path;
use std::sync::Arc;

use arrow_array::{ArrayRef, RecordBatch};
use parquet::arrow::ArrowWriter;
use parquet::basic::Compression;
use parquet::file::properties::{WriterProperties, WriterPropertiesBuilder};

pub(super) fn properties() -> WriterPropertiesBuilder {
    WriterProperties::builder().set_compression(Compression::SNAPPY)
}

/// Writes a table with the schema's `metadata`, and syncs it to disk.
pub(super) fn write_table<N: AsRef<str>>(
    path: &Path,
    columns: impl IntoIterator<Item = (N, ArrayRef)>,
    metadata: HashMap<String, String>,
) -> io::Result<()> {
    let table = RecordBatch::try_from_iter(columns).map_err(io::Error::other)?;
    // pyarrow takes only the schema metadata that arrow writes.
    let schema = Arc::new(table.schema().as_ref().clone().with_metadata(metadata));
    let table = table
        .with_schema(schema.clone())
        .map_err(io::Error::other)?;
    let properties = Some(properties().build());
    let mut writer = ArrowWriter::try_new(File::create_new(path)?, schema, properties)
        .map_err(io::Error::other)?;
    writer.write(&table).map_err(io::Error::other)?;
    writer.into_inner().map_err(io::Error::other)?.sync_all()
}
