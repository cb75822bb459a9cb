//! The verdict FAILED as an error.

use std::fmt;

/// An error that means the verdict FAILED, with its exit code.
#[derive(Debug)]
pub struct AuditFailed(pub String);

impl fmt::Display for AuditFailed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}
