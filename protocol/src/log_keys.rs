//! The keys that a log has had ([`crate::tlog::key_rotation`]).

use crate::entries::entry::Body;
use crate::entries::genesis::Genesis;
use crate::signed_statement::{SignatureError, Signed};
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

    /// Takes entry `index` of the log of `genesis`. The rules have not checked it, so a change of the key has to count here.
    ///
    /// # Errors
    /// Why it does not count.
    pub fn follow(&mut self, genesis: &Genesis, index: u64, body: &Body) -> Result<(), String> {
        if let Body::LogKeyRotated { rotation, takeover } = body {
            let bad = |error: SignatureError| error.to_string();
            let given = rotation.verify().map_err(bad)?;
            let counts = takeover.verify().map_err(bad)?.rotation == *given
                && given.operator.0 == genesis.log_key
                && given.network == genesis.network_id()
                && given.log == genesis.origin()
                && given.entry == index
                && !self.have(&given.with.0);
            if !counts {
                return Err(format!(
                    "it gives the log the key {}, and does not count here",
                    given.with
                ));
            }
        }
        self.observe(body);
        Ok(())
    }

    /// Takes the log's next entry, which the rules allow.
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

    /// Whether the log had this key, and has another one: this one may be stolen.
    pub fn is_former(&self, key: &[u8; 32]) -> bool {
        self.have(key) && self.present() != key
    }

    /// Whether the log has or had this key.
    pub fn have(&self, key: &[u8; 32]) -> bool {
        let mut rotations = self.rotations.iter();
        self.founding == *key || rotations.any(|rotation| rotation.statement.with.0 == *key)
    }
}
