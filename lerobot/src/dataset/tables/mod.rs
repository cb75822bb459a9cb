//! The parquet files: their columns, and the states and actions in them.

pub(crate) mod columns;
pub(crate) mod motion;
mod parquet_pages;
mod thrift;
pub(crate) mod unfinished;
pub(crate) mod whole_rows;
