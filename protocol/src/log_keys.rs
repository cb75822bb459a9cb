//! The keys that a log has had ([`crate::tlog::key_rotation`]).

use crate::entries::entry::Body;
use crate::entries::genesis::Genesis;
use crate::signed_statement::Signed;
use crate::tlog::key_rotation::LogKeyRotation;
use borsh::{BorshDeserialize, BorshSerialize};

/// A log's keys, from the founding one to the present one.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct LogKeys {
    founding: [u8; 32],
    rotations: Vec<Signed<LogKeyRotation>>,
}

impl LogKeys {
    /// The log's keys at its founding.
    pub fn of(genesis: &Genesis) -> Self {
        Self {
            founding: genesis.log_key,
            rotations: Vec::new(),
        }
    }

    /// Takes the log's next entry.
    pub fn observe(&mut self, body: &Body) {
        if let Body::LogKeyRotated { rotation, .. } = body {
            self.rotations.push(rotation.clone());
        }
    }

    /// The key that signs the next checkpoint.
    pub fn present(&self) -> &[u8; 32] {
        self.at(u64::MAX)
    }

    /// The key that signs the checkpoint of the first `size` entries.
    pub fn at(&self, size: u64) -> &[u8; 32] {
        let mut latest = self.rotations.iter().rev();
        let rotation = latest.find(|rotation| rotation.statement.entry < size);
        rotation.map_or(&self.founding, |rotation| &rotation.statement.with.0)
    }

    /// The operator's statement about the present key; `None` for the founding key.
    pub fn rotation(&self) -> Option<&Signed<LogKeyRotation>> {
        self.rotations.last()
    }

    /// Whether the log has or had this key.
    pub fn have(&self, key: &[u8; 32]) -> bool {
        let mut rotations = self.rotations.iter();
        self.founding == *key || rotations.any(|rotation| rotation.statement.with.0 == *key)
    }
}
