//! The verdict FAILED as an error.

use std::fmt;

/// What an error says first if something is wrong with what was audited. The exit code is that of the verdict FAILED.
#[derive(Debug)]
pub struct AuditFailed(pub String);

impl fmt::Display for AuditFailed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}
