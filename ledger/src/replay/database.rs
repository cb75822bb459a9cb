//! The replayed database. Its newest checkpoint must be the published one, and it must hold exactly a log of its size.

use crate::error::LedgerError;
use crate::folder;
use crate::store::{DatabaseKey, Store};
use std::path::Path;
use std::thread::sleep;
use std::time::Duration;
use tlog_tiles::tlog::stored_hash_count;

/// A database whose newest checkpoint is the published one.
pub struct OpenedDatabase {
    pub(super) store: Store,
    pub(super) size: u64,
}

impl OpenedDatabase {
    /// How many entries it has.
    pub fn size(&self) -> u64 {
        self.size
    }
}

/// Opens a database whose newest checkpoint is the published one. Tries again if a writer seems to use it.
pub fn open_published(dir: &Path) -> Result<OpenedDatabase, LedgerError> {
    const PAUSE: Duration = Duration::from_millis(20);
    let path = folder::database(dir);
    if !path.exists() {
        return Err(LedgerError::NoLedger(dir.into()));
    }
    let mut patience = 10;
    loop {
        let before = folder::read_checkpoint(dir)?;
        let opened = open_once(dir, &path);
        sleep(match &opened {
            Ok(_) => return opened,
            Err(_) => PAUSE,
        });
        // A writer may just have committed or published.
        let between = matches!(&opened, Err(LedgerError::OtherPublished { published, size, .. })
            if published < size);
        patience -= 1;
        if patience == 0 || !(between || folder::read_checkpoint(dir)? != before) {
            return opened;
        }
    }
}

/// Whether the ledger may be whole despite this error: it is unreadable now; its import was killed before any write; or its writer was
/// killed between committing a group and publishing the checkpoint, which is then an earlier one of the database. All else is a fault.
pub fn is_unread(dir: &Path, error: &LedgerError) -> bool {
    match error {
        LedgerError::Unfinished(_) => true,
        LedgerError::OtherPublished {
            published, size, ..
        } => published < size && is_earlier(dir, *published).unwrap_or(false),
        error => error.is_of_reading(),
    }
}

/// Whether the database has the published checkpoint at this size.
fn is_earlier(dir: &Path, published: u64) -> Result<bool, LedgerError> {
    let held = Store::open_read_only(&folder::database(dir))?.checkpoint(published)?;
    Ok(held.is_some() && held == folder::read_checkpoint(dir)?)
}

fn open_once(dir: &Path, path: &Path) -> Result<OpenedDatabase, LedgerError> {
    let published = folder::read_checkpoint(dir)?;
    let store = Store::open_read_only(path)?;
    let size = store.size()?;
    if size == 0 {
        return Err(match published {
            None => LedgerError::Unfinished(dir.into()),
            Some(_) => LedgerError::NoLedger(dir.into()),
        });
    }
    let Some(published) = published else {
        return Err(LedgerError::NoCheckpoint(folder::checkpoint(dir)));
    };
    // A writer commits before it publishes. If it has published meanwhile, our checkpoint is in the database, perhaps not the newest.
    let at_work = folder::read_checkpoint(dir)?.as_ref() != Some(&published);
    let claimed = claimed_size(&published).unwrap_or_default();
    let at = if at_work { claimed } else { size };
    if store.checkpoint(at)? == Some(published) {
        Ok(OpenedDatabase { store, size })
    } else {
        Err(LedgerError::OtherPublished {
            path: folder::checkpoint(dir),
            published: claimed,
            size,
        })
    }
}

/// The size that a checkpoint's text claims, unverified.
fn claimed_size(text: &[u8]) -> Option<u64> {
    let line = text.split(|byte| *byte == b'\n').nth(1)?;
    std::str::from_utf8(line).ok()?.parse().ok()
}

/// Checks that the database has every entry and hash of a log of this size, checkpoints where groups ended, and no other keys.
pub fn check_keys(store: &Store, size: u64) -> Result<(), LedgerError> {
    let (mut entries, mut hashes) = (0..size, 0..stored_hash_count(size));
    for key in store.keys() {
        let key = key?;
        let expected = match key {
            Some(DatabaseKey::Entry(_)) => entries.next().map(DatabaseKey::Entry),
            Some(DatabaseKey::Hash(_)) => hashes.next().map(DatabaseKey::Hash),
            Some(DatabaseKey::Checkpoint(at)) => (1..=size)
                .contains(&at)
                .then_some(DatabaseKey::Checkpoint(at)),
            None => None,
        };
        if expected.is_none() || key != expected {
            let found = key.map_or("an unknown key".into(), |key| format!("{key:?}"));
            return Err(LedgerError::StrayKey { found, size });
        }
    }
    if let Some(index) = entries.next() {
        let why = "the entry is missing".into();
        return Err(LedgerError::BadEntry { index, why });
    }
    match hashes.next() {
        Some(position) => Err(LedgerError::Tree(format!("hash {position} is missing"))),
        None => Ok(()),
    }
}

/// Checks that the database has no checkpoint beyond this size. For a log whose first entries were verified before: a replay of the others
/// checks that they are there.
pub fn check_last_key(store: &Store, size: u64) -> Result<(), LedgerError> {
    match store.checkpoint_from(size.saturating_add(1))? {
        None => Ok(()),
        Some((beyond, _)) => {
            let found = format!("{:?}", DatabaseKey::Checkpoint(beyond));
            Err(LedgerError::StrayKey { found, size })
        }
    }
}
