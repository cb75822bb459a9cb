//! Checks of members' keys, names and lines of text.

use crate::public_key::public_key;
use crate::tlog::names::MAX_NAME_BYTES;
use zk0_circuits::NodeId;

pub(crate) const NOT_A_KEY: &str = "its identity is not an ed25519 public key";

/// Refuses what is no public key, or one for which anybody can sign. Takes about a tenth of a signature check.
pub fn check_identity(key: &NodeId) -> Result<(), String> {
    match public_key(&key.0) {
        Some(_) => Ok(()),
        None => Err(NOT_A_KEY.into()),
    }
}

/// Checks a member's name: one line of text.
pub fn check_member_name(name: &str) -> Result<(), String> {
    check_line("its name", name, MAX_NAME_BYTES)
}

/// Checks for one line of at most `most` bytes. The error begins with `what`.
pub fn check_line(what: &str, text: &str, most: usize) -> Result<(), String> {
    if text.is_empty() || text.len() > most || text.chars().any(char::is_control) {
        Err(format!(
            "{what} has {} bytes; 1 to {most} without control characters are allowed",
            text.len()
        ))
    } else {
        Ok(())
    }
}
