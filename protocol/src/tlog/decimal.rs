//! Decimal numbers as the C2SP formats write them.

/// Reads a number that has no leading zeroes and no sign.
pub fn decimal(text: &str) -> Option<u64> {
    let number: u64 = text.parse().ok()?;
    (number.to_string() == text).then_some(number)
}
