//! The log gets another key. Its operator, who has the key that founded the network, signs that, and is there when what was pruned is signed
//! again: without the operator, a thief of a former key could have it signed what it likes.

use super::Ledger;
use crate::error::LedgerError;
use crate::pruned::{self, SignedPruning};
use ed25519_dalek::SigningKey;
use zk0_circuits::NodeId;
use zk0_protocol::entries::entry::Body;
use zk0_protocol::entries::signed::Signed;
use zk0_protocol::tlog::key_rotation::{LogKeyRotation, LogKeyTakeover};
use zk0_protocol::tlog::receipt::Receipt;

impl Ledger {
    /// Gives the log the key that it was opened with ([`Ledger::open_to_rotate`]). `operator` is the key that founded the network. From this
    /// entry on, the new key signs, and signs again what was pruned. If the log has the key already, this ends what was interrupted, and
    /// returns the receipt of that entry.
    pub fn rotate_key(
        &mut self,
        operator: &SigningKey,
        time_ms: u64,
    ) -> Result<Receipt, LedgerError> {
        if self.state.genesis().log_key != operator.verifying_key().to_bytes() {
            return Err(LedgerError::NotOperatorsKey(*self.state.network()));
        }
        let given = self.given();
        // What cannot be signed again is refused before the log has another key.
        let former = self.former_pruning(given.unwrap_or(self.size()))?;
        let receipt = match given {
            Some(entry) => self.first_receipt(entry)?,
            None => self.append_rotation(operator, time_ms)?,
        };
        if let Some(former) = former {
            let keys = self.state.log_keys();
            let signed = SignedPruning::new(&self.sign(former.by_present(keys)), keys.rotation());
            let known = (self.state.genesis(), keys);
            pruned::publish(&self.dir, &self.blobs, known, &signed)?;
        }
        Ok(receipt)
    }

    /// The entry that gave the log the key that it was opened with, if that is its present one.
    fn given(&self) -> Option<u64> {
        let rotation = &self.state.log_keys().rotation()?.statement;
        let is_present = rotation.with.0 == self.key.verifying_key().to_bytes();
        is_present.then_some(rotation.entry)
    }

    /// What was pruned, if the key has signed it that the log had just before `entry`.
    ///
    /// # Errors
    /// Somebody else has signed it: an earlier key, or this one when the log had it no more.
    fn former_pruning(&self, entry: u64) -> Result<Option<SignedPruning>, LedgerError> {
        let keys = self.state.log_keys();
        let found = pruned::find(&self.dir, &self.blobs, self.state.genesis())?;
        let Some((from, signed)) = found else {
            return Ok(None);
        };
        let (signer, about) = (signed.statement.operator, signed.statement.entries);
        let before = NodeId(*keys.at(entry));
        if signer == before && about <= entry {
            Ok(Some(signed))
        } else if signed.is_by_present(keys) {
            Ok(None)
        } else {
            Err(LedgerError::BadPruning {
                from,
                why: format!("{signer} has signed it, about {about} entries, and the log's key of its first {entry} entries is {before}"),
            })
        }
    }

    fn append_rotation(
        &mut self,
        operator: &SigningKey,
        time_ms: u64,
    ) -> Result<Receipt, LedgerError> {
        let genesis = self.state.genesis();
        let rotation = LogKeyRotation {
            network: *self.state.network(),
            log: genesis.origin().into(),
            operator: NodeId(genesis.log_key),
            with: NodeId(self.key.verifying_key().to_bytes()),
            entry: self.size(),
        };
        let takeover = LogKeyTakeover {
            rotation: rotation.clone(),
        };
        let body = Body::LogKeyRotated {
            rotation: Signed::new(rotation, operator),
            takeover: self.sign(takeover),
        };
        self.append(time_ms, body)
    }
}
