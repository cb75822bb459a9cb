//! The parquet files: their columns, and the states and actions in them.

pub(crate) mod columns;
pub(crate) mod motion;
pub(crate) mod parquet_files;
mod parquet_pages;
