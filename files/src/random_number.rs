//! Random numbers for the names of files.
//!
//! A process id is not enough for a name that nobody else uses. Processes in several containers have the same id and may share a folder, and a
//! process that is started again in its container has the id of the one before, which may have left files behind.

use std::io;

/// A number that nobody else draws.
///
/// # Errors
/// The system gives no random bytes.
pub fn random_number() -> io::Result<u64> {
    getrandom::u64()
        .map_err(|error| io::Error::other(format!("the system gives no random bytes: {error}")))
}
