//! Basis points: hundredths of a percent.

/// Basis points in one: 10,000.
pub const BPS: u32 = 10_000;
