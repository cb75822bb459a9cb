//! Decimal numbers of the C2SP formats.

/// Reads a number without leading zeroes and sign.
pub fn decimal(text: &str) -> Option<u64> {
    let number: u64 = text.parse().ok()?;
    (number.to_string() == text).then_some(number)
}
