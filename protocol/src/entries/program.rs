//! The guest program of a network's proofs, and the SP1 release that verifies them.

use crate::quote::short;
use borsh::{BorshDeserialize, BorshSerialize};

/// The SP1 release of a genesis' program. It never changes, because ledgers rest on it.
pub const FOUNDING_SP1: &str = "6.10.0";

/// The SP1 release of this workspace, pinned in `Cargo.toml`.
pub const OUR_SP1: &str = "6.10.0";

/// Longest name of an SP1 release, in bytes.
pub const MAX_SP1_BYTES: usize = 32;

/// The KoalaBear prime, 2^31 − 2^24 + 1.
const MODULUS: u32 = 0x7f00_0001;

/// A guest program.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Program {
    /// Its verifying key, as in a genesis.
    pub key: Vec<u8>,
    /// The SP1 release that verifies its proofs, such as "6.10.0".
    pub sp1: String,
}

/// Why a network cannot use a program. The texts can become data of the ledger, so they never change.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ProgramError {
    /// No program has this key.
    #[error("there is no such program: {0}")]
    Key(#[from] ProgramKeyError),
    /// The SP1 release is not a valid name.
    #[error("'{}' is not a release of SP1: its name has 1 to {MAX_SP1_BYTES} bytes, of the characters a-z, 0-9, '.' and '-'", short(.0))]
    Sp1(String),
}

impl Program {
    /// The program of a genesis with this `key`.
    pub fn founding(key: &[u8]) -> Self {
        Self {
            key: key.to_vec(),
            sp1: FOUNDING_SP1.into(),
        }
    }

    /// Checks the form of the key and of the release's name. The ledger cannot know who has that release's verifier.
    pub fn check(&self) -> Result<(), ProgramError> {
        ProgramKey::from_bytes(&self.key)?;
        let of_a_name = |c: u8| matches!(c, b'a'..=b'z' | b'0'..=b'9' | b'.' | b'-');
        if (1..=MAX_SP1_BYTES).contains(&self.sp1.len()) && self.sp1.bytes().all(of_a_name) {
            Ok(())
        } else {
            Err(ProgramError::Sp1(self.sp1.clone()))
        }
    }
}

impl std::fmt::Display for Program {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for byte in &self.key {
            write!(f, "{byte:02x}")?;
        }
        write!(f, " of SP1 {}", short(&self.sp1))
    }
}

/// Verifying key of a guest program: SP1's `hash_koalabear`, eight field elements of four bytes, little endian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ProgramKey([u8; 32]);

/// Why bytes are not a verifying key. The texts are data of ledgers, so they never change.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ProgramKeyError {
    /// The key does not have eight elements.
    #[error("a program's verifying key has 32 bytes, this one has {0}")]
    Length(usize),
    /// An element is not below the field's modulus.
    #[error("element {index} of the program's verifying key is {value}, which is not a KoalaBear element")]
    NotCanonical { index: usize, value: u32 },
}

impl ProgramKey {
    /// Reads a genesis' key.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, ProgramKeyError> {
        let key: [u8; 32] = bytes
            .try_into()
            .map_err(|_| ProgramKeyError::Length(bytes.len()))?;
        for (index, element) in key.chunks_exact(4).enumerate() {
            let value = u32::from_le_bytes([element[0], element[1], element[2], element[3]]);
            if value >= MODULUS {
                return Err(ProgramKeyError::NotCanonical { index, value });
            }
        }
        Ok(Self(key))
    }

    /// The bytes of the key.
    pub fn as_bytes(&self) -> &[u8; 32] {
        &self.0
    }
}
