//! One instance of a statement, as the prover has it.

use super::tables::{Computed, Tables};
use super::values::Values;
use crate::relation::Relations;

/// One instance of a statement: its relations, in which the axis of instances has one index, and the values of each source, by number.
pub struct Instance<'a> {
    /// The relations.
    pub relations: &'a Relations,
    /// The values.
    pub sources: Vec<Values<'a>>,
}

impl Instance<'_> {
    /// Computes values. What takes long is kept in `computed`.
    pub fn tables<'r>(&'r self, computed: &'r Computed) -> Tables<'r> {
        Tables {
            relations: self.relations,
            sources: &self.sources,
            computed,
        }
    }
}
