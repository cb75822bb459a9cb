//! How error messages quote what a stranger wrote.

/// Most characters of a text that a message quotes.
const MAX_QUOTED: usize = 128;

/// A text as a message quotes it: kept short, with everything escaped that could do something to a terminal.
pub fn short(text: &str) -> String {
    text.chars()
        .take(MAX_QUOTED)
        .flat_map(char::escape_debug)
        .collect()
}
