//! What an index of a tensor is about.

/// An axis: its number in [`super::Relations::axes`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Axis(pub u8);
