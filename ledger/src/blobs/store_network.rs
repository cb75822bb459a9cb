//! A store names the network whose blobs it holds. If two networks shared a store, no entry of one would name the other's blobs, and
//! pruning would delete them.

use super::error::StoreError;
use super::store::IndexedStore;
use super::Blobs;
use crate::error::LedgerError;
use crate::folder;
use crate::store::Store;
use std::path::PathBuf;
use zk0_circuits::Digest;
use zk0_files::atomic_file::folder_of;
use zk0_protocol::entries::entry::{Body, Entry};
use zk0_protocol::rules::named_blobs::named_blobs;
use zk0_protocol::rules::violation::RuleViolation;

/// Why the blobs of a ledger are not kept in a store.
#[derive(Debug, thiserror::Error)]
pub enum StoreNetworkError {
    /// The store belongs to another network.
    #[error("the blob store {address} belongs to network {found}, and the ledger in {dir} is of network {network}: name the store of this ledger, or an empty one, such as another prefix of the bucket. Nothing was changed there")]
    OtherNetwork {
        address: String,
        found: Digest,
        dir: PathBuf,
        network: Digest,
    },
    /// The store names no network, and holds blobs, but none of this ledger.
    #[error("the blob store {address} names no network, and no entry of the ledger in {dir} names one of its {blobs} blobs: name the store of this ledger, or an empty one, such as another prefix of the bucket. If this is the right one, put an object `network` there that holds the id {network}. Nothing was changed there")]
    Stranger {
        address: String,
        blobs: usize,
        dir: PathBuf,
        network: Digest,
    },
    /// The store failed.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The ledger cannot be read.
    #[error(transparent)]
    Ledger(#[from] LedgerError),
}

impl Blobs {
    /// Compares the network that the store names, if there is a store, with that of the ledger in the folder, if there is one. If the store
    /// names none, the ledger's writer makes it name this one. For that, the store must be empty, or hold a blob of the ledger.
    ///
    /// # Errors
    /// The store is not this ledger's, or does not answer; or the ledger cannot be read.
    pub fn check_network(&self) -> Result<(), StoreNetworkError> {
        let dir = folder_of(&self.dir);
        let database = folder::database(dir);
        let Some(kept) = self.kept.as_ref().filter(|_| Store::is_in(&database)) else {
            return Ok(());
        };
        let ledger = Store::open_read_only(&database)?;
        if ledger.size()? == 0 {
            return Ok(());
        }
        let Body::Genesis(genesis) = entry(&ledger, 0)? else {
            return Err(LedgerError::from(RuleViolation::NoGenesis).into());
        };
        let network = genesis.network_id();
        let found = match kept.store.network()? {
            Some(found) => found,
            None if kept.shared => return Ok(()),
            None => {
                let blobs = kept.all().len();
                if blobs > 0 && !names_one(&ledger, kept)? {
                    return Err(StoreNetworkError::Stranger {
                        address: kept.address().into(),
                        blobs,
                        dir: dir.into(),
                        network,
                    });
                }
                kept.store.name_network(&network)?
            }
        };
        if found == network {
            Ok(())
        } else {
            Err(StoreNetworkError::OtherNetwork {
                address: kept.address().into(),
                found,
                dir: dir.into(),
                network,
            })
        }
    }
}

/// Whether an entry of the ledger names a blob of the store.
fn names_one(ledger: &Store, kept: &IndexedStore) -> Result<bool, LedgerError> {
    for index in 0..ledger.size()? {
        let named = named_blobs(&entry(ledger, index)?);
        if named.iter().any(|blob| kept.knows(&blob.digest)) {
            return Ok(true);
        }
    }
    Ok(false)
}

fn entry(ledger: &Store, index: u64) -> Result<Body, LedgerError> {
    let bytes = ledger.entry(index)?.ok_or(LedgerError::NoEntry(index))?;
    Ok(Entry::decode(&bytes)?.body)
}
