//! Random numbers for unique names of files.
//!
//! A process id is not enough: containers that share a folder can have processes with the same id, and a restarted process has the id of
//! the one before, which may have left files.

use std::io;

/// A number that no other process draws.
///
/// # Errors
/// The system gives no random bytes.
pub fn random_number() -> io::Result<u64> {
    getrandom::u64()
        .map_err(|error| io::Error::other(format!("the system gives no random bytes: {error}")))
}
