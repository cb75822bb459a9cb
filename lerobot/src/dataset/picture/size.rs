//! The size of a picture, which `meta/info.json` names.

/// Refuses a picture of another size than `meta/info.json` names, before there is room for its pixels.
pub(super) fn check_size(found: (usize, usize), expected: (usize, usize)) -> Result<(), String> {
    if found == expected {
        return Ok(());
    }
    Err(format!(
        "the picture is {} x {} (height x width), meta/info.json says {} x {}",
        found.0, found.1, expected.0, expected.1
    ))
}
