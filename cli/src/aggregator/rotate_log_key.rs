//! `zk0 aggregator rotate-log-key`: the operator gives the log another key.

use crate::blob_store::BlobStoreOptions;
use crate::keys;
use crate::output::println;
use anyhow::{bail, Result};
use ed25519_dalek::SigningKey;
use std::path::{Path, PathBuf};
use zk0_aggregator::{Clock, SystemClock};
use zk0_ledger::blobs::Blobs;
use zk0_ledger::{pruned, Ledger, LedgerError};
use zk0_protocol::challenge::source::RandomnessSource;

/// `zk0 aggregator rotate-log-key`.
#[derive(Debug, clap::Args)]
pub struct RotateLogKey {
    /// The ledger's folder, while no aggregator runs. With --blob-store, an empty one is filled from the store.
    dir: PathBuf,
    /// The file of the operator's key: the key that founded the network.
    #[arg(long, value_name = "FILE")]
    operator_key: PathBuf,
    /// The file of the log's new key, made by `zk0 aggregator keygen`.
    #[arg(long, value_name = "FILE")]
    key: PathBuf,
    #[command(flatten)]
    store: BlobStoreOptions,
}

/// Runs the command.
pub fn rotate(options: &RotateLogKey) -> Result<()> {
    let operator = keys::read(&options.operator_key)?;
    let key = keys::read(&options.key)?;
    let identity = keys::identity(&key);
    let blobs = options.store.blobs(&options.dir)?;
    let (_, entry) = give(&options.dir, &operator, key, blobs)?;
    println!("entry {entry}: the log's key is {identity}");
    println!("serve with --key {}", options.key.display());
    Ok(())
}

/// Gives the log of the ledger in `dir` this key, unless it has it. Returns the ledger, and the entry that gave it.
pub fn give(
    dir: &Path,
    operator: &SigningKey,
    key: SigningKey,
    blobs: Blobs,
) -> Result<(Ledger, u64)> {
    let opened = Ledger::open_to_rotate(dir, None, key, None, blobs, &mut ());
    let mut ledger = match opened {
        Err(LedgerError::Locked(_)) => bail!(
            "the ledger in {} is in use, most likely by its running aggregator: stop that first",
            dir.display()
        ),
        opened => opened?,
    };
    ledger.watch_clock(SystemClock.now_ms(), || SystemClock.steady())?;
    let entry = ledger.rotate_key(operator, SystemClock.now_ms())?.index;
    if let Some(pruning) = pruned::read(dir, ledger.state().genesis())? {
        tracing::info!("the new key has signed that {pruning}");
    }
    let state = ledger.state();
    let undrawn = state.round().filter(|round| round.randomness.is_none());
    let undrawn = undrawn.filter(|_| !state.has_drawing_key());
    if let (Some(round), RandomnessSource::LogVrf) = (undrawn, &state.rules().randomness) {
        tracing::warn!(
            "round {} is open, and only the log's former key could draw its randomness: it closes without one, and nobody's contribution counts",
            round.number()
        );
    }
    Ok((ledger, entry))
}
