//! The file `pruned` in a ledger's folder: the operator's statement about blobs that are no longer kept ([`Pruning`]), signed with the
//! log's key. If that is not the founding key, the operator's statement about the key follows. If the blobs have a store, all that is there,
//! too, for an aggregator that starts in an empty folder.

use crate::blobs::entry_objects::EntryStore;
use crate::blobs::error::BlobError;
use crate::blobs::Blobs;
use crate::error::LedgerError;
use crate::folder;
use borsh::BorshDeserialize;
use std::path::Path;
use zk0_circuits::NodeId;
use zk0_protocol::log_keys::LogKeys;
use zk0_protocol::pruning::Pruning;
use zk0_protocol::tlog::key_rotation::LogKeyRotation;
use zk0_protocol::{Genesis, Signed};

/// A verified statement, and the bytes of its file. Only the entries tell whether its key is the log's present one.
#[derive(Clone, Debug)]
pub(crate) struct SignedPruning {
    pub statement: Pruning,
    /// The entry that gave the log the key; 0 for the founding key.
    since: u64,
    bytes: Vec<u8>,
}

impl SignedPruning {
    /// The statement with its signature. `rotation` has given the log its key.
    pub fn new(signed: &Signed<Pruning>, rotation: Option<&Signed<LogKeyRotation>>) -> Self {
        let mut bytes = borsh::to_vec(signed).expect("writing to a Vec cannot fail");
        if let Some(rotation) = rotation {
            bytes.extend(borsh::to_vec(rotation).expect("writing to a Vec cannot fail"));
        }
        Self {
            statement: signed.statement,
            since: rotation.map_or(0, |rotation| rotation.statement.entry),
            bytes,
        }
    }

    /// How many entries a log has that can have signed it.
    pub fn entries(&self) -> u64 {
        self.statement.entries.max(self.since.saturating_add(1))
    }

    /// Whether a log with these keys has signed it with its present one.
    pub fn is_by_present(&self, keys: &LogKeys) -> bool {
        self.statement.operator.0 == *keys.present()
    }

    /// Refuses it if it is not, whatever it states. It is in this file or object.
    fn check_present(&self, from: String, keys: &LogKeys) -> Result<(), LedgerError> {
        if self.is_by_present(keys) {
            return Ok(());
        }
        Err(LedgerError::FormerPruning {
            from,
            signer: self.statement.operator,
            present: NodeId(*keys.present()),
        })
    }

    /// The same statement, to be signed with the present one of these keys.
    pub fn by_present(&self, keys: &LogKeys) -> Pruning {
        Pruning {
            operator: NodeId(*keys.present()),
            ..self.statement
        }
    }

    /// Refuses the signature of a former key, which may be stolen. `keys` are those of the log's first `size` entries. A later one may follow.
    pub fn check_key(&self, keys: &LogKeys, size: u64) -> Result<(), LedgerError> {
        if self.is_by_present(keys) || self.since >= size {
            Ok(())
        } else {
            Err(LedgerError::BadPruning {
                from: "the file `pruned`".into(),
                why: format!(
                    "{} has signed it, and the log's present key is {}",
                    self.statement.operator,
                    NodeId(*keys.present())
                ),
            })
        }
    }

    /// The bytes of its file.
    pub fn into_bytes(self) -> Vec<u8> {
        self.bytes
    }
}

/// The operator's statement in `dir` for the log of `genesis`; `None` if nothing was pruned.
///
/// # Errors
/// The file cannot be read, or its statement does not count.
pub fn read(dir: &Path, genesis: &Genesis) -> Result<Option<Pruning>, LedgerError> {
    Ok(read_signed(dir, genesis)?.map(|signed| signed.statement))
}

/// [`read`], for a writer of the log, which signs what follows from it.
///
/// # Errors
/// The log's present key has not signed it.
pub(crate) fn read_present(
    dir: &Path,
    (genesis, keys): (&Genesis, &LogKeys),
) -> Result<Option<Pruning>, LedgerError> {
    let signed = read_signed(dir, genesis)?;
    if let Some(signed) = &signed {
        signed.check_present(file(dir), keys)?;
    }
    Ok(signed.map(|signed| signed.statement))
}

/// Refuses the folder's statement, or the store's where the folder has none, unless the log's present key has signed it.
pub(crate) fn check_present(
    dir: &Path,
    blobs: &Blobs,
    (genesis, keys): (&Genesis, &LogKeys),
) -> Result<(), LedgerError> {
    match find(dir, blobs, genesis)? {
        Some((from, signed)) => signed.check_present(from, keys),
        None => Ok(()),
    }
}

/// The folder's statement, or the store's where the folder has none, with the file or object.
pub(crate) fn find(
    dir: &Path,
    blobs: &Blobs,
    genesis: &Genesis,
) -> Result<Option<(String, SignedPruning)>, LedgerError> {
    if let Some(signed) = read_signed(dir, genesis)? {
        return Ok(Some((file(dir), signed)));
    }
    let Some(store) = blobs.entry_store() else {
        return Ok(None);
    };
    let from = format!("{}/pruned", store.place());
    Ok(stored(store, genesis)?.map(|signed| (from, signed)))
}

fn file(dir: &Path) -> String {
    folder::pruned(dir).display().to_string()
}

/// [`read_signed`] of a log of `entries` entries, which the statement must not exceed.
pub(crate) fn read_within(
    dir: &Path,
    genesis: &Genesis,
    entries: u64,
) -> Result<Option<SignedPruning>, LedgerError> {
    match read_signed(dir, genesis)? {
        Some(signed) if signed.entries() > entries => Err(LedgerError::PrunedMore {
            signed: signed.entries(),
            held: entries,
        }),
        found => Ok(found),
    }
}

/// [`read`], with the signature.
pub(crate) fn read_signed(
    dir: &Path,
    genesis: &Genesis,
) -> Result<Option<SignedPruning>, LedgerError> {
    let bytes = folder::read_pruned(dir)?;
    bytes
        .map(|bytes| decode(&file(dir), &bytes, genesis))
        .transpose()
}

/// Reads the statement from the file or address `from`.
pub(crate) fn decode(
    from: &str,
    bytes: &[u8],
    genesis: &Genesis,
) -> Result<SignedPruning, LedgerError> {
    parse(bytes, genesis).map_err(|why| LedgerError::BadPruning {
        from: from.into(),
        why,
    })
}

fn parse(bytes: &[u8], genesis: &Genesis) -> Result<SignedPruning, String> {
    let mut rest = bytes;
    let signed = Signed::<Pruning>::deserialize(&mut rest).map_err(|error| error.to_string())?;
    let statement = signed.verify().map_err(|error| error.to_string())?;
    let (key, since) = if rest.is_empty() {
        (genesis.log_key, 0)
    } else {
        given_key(rest, genesis)?
    };
    if statement.operator.0 != key {
        return Err(format!(
            "{} has signed it, and not the log's key",
            statement.operator
        ));
    }
    if statement.network != genesis.network_id() {
        return Err(format!("it is about network {}", statement.network));
    }
    Ok(SignedPruning {
        statement: *statement,
        since,
        bytes: bytes.into(),
    })
}

/// The key that the operator gave the log, by its statement, and the entry that did so.
fn given_key(rotation: &[u8], genesis: &Genesis) -> Result<([u8; 32], u64), String> {
    let signed: Signed<LogKeyRotation> =
        borsh::from_slice(rotation).map_err(|error| error.to_string())?;
    let rotation = signed.verify().map_err(|error| error.to_string())?;
    if rotation.operator.0 == genesis.log_key && rotation.network == genesis.network_id() {
        Ok((rotation.with.0, rotation.entry))
    } else {
        Err("the network's operator has not signed the statement about its key".into())
    }
}

/// Writes the bytes of a statement's file, durably.
pub(crate) fn write(dir: &Path, bytes: &[u8]) -> Result<(), LedgerError> {
    folder::write_pruned(dir, bytes)
}

/// Writes another copy's statement, unless this copy has one of a later key, or a later one of the same key.
pub(crate) fn keep_newer(
    dir: &Path,
    genesis: &Genesis,
    signed: &SignedPruning,
) -> Result<(), LedgerError> {
    let offered = &signed.statement;
    match read_signed(dir, genesis)? {
        Some(held) if held.since > signed.since => Ok(()),
        // Each statement of a key includes its earlier ones. A former key's may state anything.
        Some(SignedPruning {
            statement: held, ..
        }) if held.operator == offered.operator && offered.and(&held) != *offered => Ok(()),
        _ => write(dir, &signed.bytes),
    }
}

/// Writes the statement before a blob is deleted: first into the store of `blobs`, if they have one, then into `dir`.
///
/// # Errors
/// Another aggregator has pruned more ([`LedgerError::PrunedElsewhere`]); the store or the disk fails.
pub(crate) fn publish(
    dir: &Path,
    blobs: &Blobs,
    known: (&Genesis, &LogKeys),
    signed: &SignedPruning,
) -> Result<(), LedgerError> {
    if let Some(store) = blobs.entry_store() {
        put(store, known, signed)?;
    }
    write(dir, &signed.bytes)
}

/// Gives the folder and the store the later of the statements that the log's present key has signed, if any.
pub(crate) fn reconcile(
    dir: &Path,
    known: (&Genesis, &LogKeys),
    store: &dyn EntryStore,
) -> Result<(), LedgerError> {
    let (genesis, keys) = known;
    let counts = |signed: &SignedPruning| signed.is_by_present(keys);
    if let Some(stored) = stored(store, genesis)?.filter(counts) {
        keep_newer(dir, genesis, &stored)?;
    }
    match read_signed(dir, genesis)?.filter(counts) {
        Some(signed) => put(store, known, &signed),
        None => Ok(()),
    }
}

/// `keys` are those that the writer knows.
fn put(
    store: &dyn EntryStore,
    (genesis, keys): (&Genesis, &LogKeys),
    signed: &SignedPruning,
) -> Result<(), LedgerError> {
    let elsewhere = || LedgerError::PrunedElsewhere(store.place().into());
    match stored(store, genesis)? {
        Some(stored) if stored.bytes == signed.bytes => return Ok(()),
        // A later key's.
        Some(stored) if !keys.have(&stored.statement.operator.0) => return Err(elsewhere()),
        // A former key's does not count.
        Some(stored) if !stored.is_by_present(keys) => {}
        Some(stored) if signed.statement.and(&stored.statement) != signed.statement => {
            return Err(elsewhere());
        }
        _ => {}
    }
    Ok(store.put_pruned(&signed.bytes).map_err(BlobError::from)?)
}

fn stored(store: &dyn EntryStore, genesis: &Genesis) -> Result<Option<SignedPruning>, LedgerError> {
    let bytes = store.pruned().map_err(BlobError::from)?;
    let signed = bytes.map(|bytes| parse(&bytes, genesis)).transpose();
    signed.map_err(|why| LedgerError::StoredPruning {
        address: store.place().into(),
        why,
    })
}
