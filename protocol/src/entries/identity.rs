//! Checks of what members write: a key, a name, a line of text.

use crate::public_key::public_key;
use crate::tlog::names::MAX_NAME_BYTES;
use zk0_circuits::NodeId;

/// What a message says of an identity that is not a usable key.
pub(crate) const NOT_A_KEY: &str = "its identity is not an ed25519 public key";

/// Refuses an identity that is not a public key, and one for which anybody can sign. This takes about a tenth of the time of a
/// signature check.
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

/// Checks that a text is one line of at most `most` bytes. The error begins with `what`.
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
