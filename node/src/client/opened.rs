//! What an aggregator shows, once its signatures and proofs are verified.

use crate::client::{unexpected, NodeClient};
use crate::client_error::NodeError;
use zk0_protocol::entries::entry::Entry;
use zk0_protocol::rpc::federation as rpc;
use zk0_protocol::tlog::checkpoint::{Checkpoint, KeyedCheckpoint};
use zk0_protocol::tlog::receipt::Receipt;

impl NodeClient {
    pub(crate) fn entry(&self, receipt: rpc::Receipt) -> Result<(Checkpoint, Entry), NodeError> {
        let (_, signed, entry) = self.opened(receipt)?;
        Ok((signed.checkpoint, entry))
    }

    pub(super) fn open_checkpoint(&self, note: &[u8]) -> Result<Checkpoint, NodeError> {
        let genesis = &self.genesis;
        let signed = KeyedCheckpoint::open(note, genesis.origin(), &genesis.log_key)?;
        // Before an aggregator publishes, it shows the genesis alone, with the founding key's signature.
        if signed.checkpoint.size > 1 {
            self.seen_keys.take(&signed)?;
        }
        Ok(signed.checkpoint)
    }

    /// What a receipt shows, which the log's newest key has signed.
    pub(crate) fn opened(
        &self,
        receipt: rpc::Receipt,
    ) -> Result<(Receipt, KeyedCheckpoint, Entry), NodeError> {
        let is_published = !receipt.not_cosigned;
        let opened = self.verified(receipt)?;
        match is_published {
            true => self.seen_keys.take(&opened.1)?,
            false => self.seen_keys.check(&opened.1)?,
        }
        Ok(opened)
    }

    /// What a receipt shows that needs the checkpoint of its own size, perhaps from before the newest key.
    pub(crate) fn opened_of_size(
        &self,
        receipt: rpc::Receipt,
    ) -> Result<(Receipt, KeyedCheckpoint, Entry), NodeError> {
        let opened = self.verified(receipt)?;
        self.seen_keys.take_of_size(&opened.1)?;
        Ok(opened)
    }

    fn verified(
        &self,
        receipt: rpc::Receipt,
    ) -> Result<(Receipt, KeyedCheckpoint, Entry), NodeError> {
        let receipt = Receipt::try_from(receipt)
            .map_err(|error| unexpected("a hash of 32 bytes", format!("{} bytes", error.0)))?;
        let genesis = &self.genesis;
        let (signed, entry) = receipt.verify_keyed(&genesis.log_key, genesis.origin())?;
        Ok((receipt, signed, entry))
    }
}
