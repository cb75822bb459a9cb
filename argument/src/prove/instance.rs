//! One instance of a statement, as the prover has it.

use super::tables::{Computed, Tables};
use super::values::SourceValues;
use crate::relation::Relations;

/// One instance of a statement: its relations, in which the axis of instances has one index, and the values of each source, by number.
pub struct Instance<'a> {
    /// The relations.
    pub relations: &'a Relations,
    /// The values.
    pub sources: Vec<SourceValues<'a>>,
}

impl Instance<'_> {
    /// Computes with its values. Those that are in files are dropped from the process's memory afterwards, so that the values of one instance
    /// are in memory at a time.
    pub fn with<T>(&self, compute: impl FnOnce(&Tables<'_>) -> T) -> T {
        let result = compute(&Tables {
            relations: self.relations,
            sources: &self.sources,
            computed: &Computed::default(),
        });
        self.release();
        result
    }

    /// Drops values that are in files from the process's memory, until somebody uses them again.
    pub fn release(&self) {
        self.sources.iter().for_each(SourceValues::release);
    }
}
