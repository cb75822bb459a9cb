//! `zk0 aggregator rotate-log-key`: the operator gives the log another key.

use crate::blob_store::BlobStoreOptions;
use crate::keys;
use crate::output::println;
use anyhow::{bail, Result};
use ed25519_dalek::SigningKey;
use std::path::{Path, PathBuf};
use zk0_aggregator::{Clock, SystemClock};
use zk0_ledger::blobs::Blobs;
use zk0_ledger::{Ledger, LedgerError};
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
    let ledger = give(&options.dir, &operator, key, blobs)?;
    let entry = ledger.size().saturating_sub(1);
    println!("entry {entry}: the log's key is {identity}");
    println!("serve with --key {}", options.key.display());
    Ok(())
}

/// Gives the log of the ledger in `dir` this key.
pub fn give(dir: &Path, operator: &SigningKey, key: SigningKey, blobs: Blobs) -> Result<Ledger> {
    let opened = Ledger::open_to_rotate(dir, None, key, None, blobs, &mut ());
    let mut ledger = match opened {
        Err(LedgerError::Locked(_)) => bail!(
            "the ledger in {} is in use, most likely by its running aggregator: stop that first",
            dir.display()
        ),
        opened => opened?,
    };
    ledger.watch_clock(SystemClock.now_ms(), || SystemClock.steady())?;
    ledger.rotate_key(operator, SystemClock.now_ms())?;
    let state = ledger.state();
    let undrawn = state.round().filter(|round| round.randomness.is_none());
    if let (Some(round), RandomnessSource::LogVrf) = (undrawn, &state.rules().randomness) {
        tracing::warn!(
            "round {} is open, and only the log's former key could draw its randomness: it closes without one, and nobody's contribution counts",
            round.number()
        );
    }
    Ok(ledger)
}
