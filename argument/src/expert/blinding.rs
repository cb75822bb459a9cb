//! The secret that hides samples.

/// The secret of a registered dataset: what hides its samples in arguments follows from it. Whoever has it and the rows that arguments open can
/// find the samples, so the node gives it to nobody but its auditors, and never uses it for a second registration.
pub struct Blind([u8; 32]);

impl Blind {
    /// From 32 bytes that nobody can guess.
    pub const fn new(bytes: [u8; 32]) -> Self {
        Self(bytes)
    }
}
