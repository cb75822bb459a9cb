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

/// Properties of all tables.
pub(super) fn properties() -> WriterPropertiesBuilder {
    WriterProperties::builder().set_compression(Compression::SNAPPY)
}

/// Writes a table with `metadata` of its schema. It is on the disk when this returns.
pub(super) fn write_table<N: AsRef<str>>(
    path: &Path,
    columns: impl IntoIterator<Item = (N, ArrayRef)>,
    metadata: HashMap<String, String>,
) -> io::Result<()> {
    let table = RecordBatch::try_from_iter(columns).map_err(io::Error::other)?;
    // pyarrow takes the metadata of the schema that arrow writes, and no other.
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
