//! How error messages quote what a stranger wrote.

/// Most characters of a text that a message quotes.
const MAX_QUOTED: usize = 128;

/// Shortens a text and escapes every character that could control a terminal, so that a message can quote it.
pub fn short(text: &str) -> String {
    text.chars()
        .take(MAX_QUOTED)
        .flat_map(char::escape_debug)
        .collect()
}
