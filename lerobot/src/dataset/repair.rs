//! Faults of a recording that can be read in one way only. The reader corrects them and reports them.

use std::fmt;
use std::path::PathBuf;

/// A fault that was put right in memory; the files are as they were.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Repair {
    /// A data file holds rows twice or more often, all copies alike (LeRobot issue 1875); the first copies were read.
    RepeatedRows {
        /// The parquet file.
        path: PathBuf,
        /// Rows left out.
        rows: usize,
        /// Row of the file, from 0, at which the first of them is.
        first: usize,
    },
    /// An episode is described twice or more often in the metadata, always alike.
    RepeatedEpisodes {
        /// The metadata file.
        path: PathBuf,
        /// Descriptions left out.
        rows: usize,
    },
}

impl fmt::Display for Repair {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::RepeatedRows { path, rows, first } => write!(
                f,
                "{}: {rows} rows repeat frames that are there already (the first is row {first}); the copies are alike and \
                 were left out",
                path.display()
            ),
            Self::RepeatedEpisodes { path, rows } => write!(
                f,
                "{}: {rows} rows describe episodes that are there already; the copies are alike and were left out",
                path.display()
            ),
        }
    }
}
