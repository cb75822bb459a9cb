//! The parquet files: their columns, the states and actions in them, and the pictures.

pub(crate) mod columns;
mod fault;
pub(crate) mod motion;
mod numbers;
mod page_codecs;
mod parquet_file;
pub(crate) mod parquet_files;
mod parquet_pages;
pub(crate) mod pictures;
pub(crate) mod spread;
mod thrift;
pub(crate) mod unfinished;
pub(crate) mod whole_rows;
