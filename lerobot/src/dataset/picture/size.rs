//! The size of a picture.

/// Refuses a picture of another size than in `meta/info.json` before memory is allocated.
pub(super) fn check_size(found: (usize, usize), expected: (usize, usize)) -> Result<(), String> {
    if found == expected {
        return Ok(());
    }
    Err(format!(
        "the picture is {} x {} (height x width), meta/info.json states {} x {}",
        found.0, found.1, expected.0, expected.1
    ))
}
