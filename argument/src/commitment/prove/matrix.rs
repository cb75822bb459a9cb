//! What is committed to: columns of one height, and what hides them.

use super::columns::{to_rows, Column};
use super::encode::Encoder;
use crate::field::Goldilocks;
use p3_goldilocks::Goldilocks as Theirs;
use std::io;
use std::path::Path;

/// Columns that are encoded together, with the random coefficients that follow the values of each.
pub struct CodeMatrix {
    pub(super) columns: Vec<Column>,
    pub(super) tails: Vec<Vec<Goldilocks>>,
}

impl CodeMatrix {
    /// Columns, and a tail for each.
    pub fn new(columns: Vec<Column>, tails: Vec<Vec<Goldilocks>>) -> Self {
        Self { columns, tails }
    }

    /// Moves the values to files in a folder, if there is one.
    pub fn into_files(mut self, folder: Option<&Path>) -> io::Result<Self> {
        if let Some(folder) = folder {
            let columns = self.columns.into_iter();
            let moved = columns.map(|column| column.into_file(folder));
            self.columns = moved.collect::<io::Result<_>>()?;
        }
        Ok(self)
    }

    /// The values.
    pub fn columns(&self) -> &[Column] {
        &self.columns
    }

    pub(super) fn width(&self) -> usize {
        self.columns.len()
    }

    /// Drops values that are in files from the process's memory, until somebody uses them again.
    pub(super) fn release(&self) {
        self.columns.iter().for_each(Column::release);
    }

    /// The codewords on one coset, by rows.
    pub(super) fn coset(&self, encoder: &Encoder, coset: usize) -> Vec<Theirs> {
        let tails = self.tails.iter().map(Vec::as_slice).collect::<Vec<_>>();
        encoder.coset(to_rows(&self.columns), &tails, coset)
    }
}
