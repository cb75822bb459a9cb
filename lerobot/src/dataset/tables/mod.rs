//! The parquet files: columns, states, actions and pictures.

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
