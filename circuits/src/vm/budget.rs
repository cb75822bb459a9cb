//! The cycle budget. A guest program built with the feature `budget` tells SP1's executor when an operation starts and ends, and
//! the executor adds up the cycles of each. In any other build, this module does nothing.

/// An operation in progress; it ends when this is dropped. Operations do not overlap.
#[must_use]
pub struct Operation {
    #[cfg(all(feature = "budget", target_os = "zkvm"))]
    name: &'static str,
}

/// Starts an operation.
#[inline(always)]
pub fn operation(#[allow(unused)] name: &'static str) -> Operation {
    #[cfg(all(feature = "budget", target_os = "zkvm"))]
    crate::vm::system_calls::print(&alloc::format!("cycle-tracker-report-start: {name}\n"));
    Operation {
        #[cfg(all(feature = "budget", target_os = "zkvm"))]
        name,
    }
}

impl Operation {
    /// Ends the operation before the end of its scope.
    pub fn end(self) {}
}

#[cfg(all(feature = "budget", target_os = "zkvm"))]
impl Drop for Operation {
    fn drop(&mut self) {
        crate::vm::system_calls::print(&alloc::format!(
            "cycle-tracker-report-end: {}\n",
            self.name
        ));
    }
}
