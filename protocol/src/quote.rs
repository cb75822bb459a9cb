//! How error messages quote a stranger's text.

/// The most characters quoted.
const MAX_QUOTED: usize = 128;

/// Shortens a text and escapes every character that could control a terminal.
pub fn short(text: &str) -> String {
    text.chars()
        .take(MAX_QUOTED)
        .flat_map(char::escape_debug)
        .collect()
}
