//! Modes by name, for command lines: host code, which changes nothing in the guest programs.

use crate::statement::Mode;

impl Mode {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Direct, Self::Checked];
}

/// Not the name of a [`Mode`].
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("'{0}' is no mode; there are direct and checked")]
pub struct UnknownMode(String);

impl core::str::FromStr for Mode {
    type Err = UnknownMode;

    fn from_str(text: &str) -> Result<Self, UnknownMode> {
        match text {
            "direct" => Ok(Self::Direct),
            "checked" => Ok(Self::Checked),
            _ => Err(UnknownMode(text.into())),
        }
    }
}
