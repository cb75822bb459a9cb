//! Names of logs, witnesses and nodes.

/// Longest name of a network, log, witness or node, in bytes.
pub const MAX_NAME_BYTES: usize = 128;

/// Whether a signed note can hold a name (C2SP signed-note): 1 to [`MAX_NAME_BYTES`] bytes, without spaces, plus signs or control
/// characters.
pub fn is_log_name(name: &str) -> bool {
    let printable = name.chars().all(|c| !c.is_control());
    signed_note::is_key_name_valid(name) && printable && name.len() <= MAX_NAME_BYTES
}
