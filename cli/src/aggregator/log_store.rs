//! `zk0 aggregator serve --log-store ADDRESS`: writes the published log to a bucket that anybody may read.
//!
//! The rounds do not wait. The log and the status show a failure, and it is tried again.

use crate::blob_store::BlobStoreOptions;
use anyhow::{bail, Context, Result};
use std::collections::BTreeSet;
use std::fmt;
use std::panic::resume_unwind;
use std::path::{Path, PathBuf};
use std::time::Duration;
use tokio::sync::oneshot;
use tokio::task::spawn_blocking;
use tokio::time::sleep;
use zk0_aggregator::Service;
use zk0_circuits::Digest;
use zk0_ledger::blobs::Blobs;
use zk0_ledger::bucket::public_log::PublicLog;
use zk0_ledger::error::LedgerError;
use zk0_ledger::published::export::{export_new, export_to, ExportError};
use zk0_ledger::published::export_place::ExportTarget;
use zk0_ledger::published::publication::{Publication, PublicationError};
use zk0_ledger::Ledger;
use zk0_protocol::rpc::federation::trouble::Kind;
use zk0_protocol::tlog::checkpoint::MAX_NOTE_BYTES;
use zk0_protocol::WitnessPolicy;

const TICK: Duration = Duration::from_secs(1);

const RETRY: Duration = Duration::from_secs(10);

const OF_STORE: [Kind; 2] = [Kind::LogStore, Kind::Fork];

/// Where the published log is written.
#[derive(Debug, clap::Args)]
pub struct LogStoreOptions {
    /// Also write the published log (checkpoint, tiles, and the weights and proofs that are public) as files into the store at this address, in
    /// the form of --blob-store, and with the same credentials. Anybody may read them there: this must not be the address of --blob-store
    #[arg(long, value_name = "ADDRESS")]
    log_store: Option<String>,
}

/// Writes the published log.
pub struct LogStore {
    dir: PathBuf,
    blobs: Blobs,
    place: PublicLog,
    before: Option<Publication>,
    named: BTreeSet<Digest>,
    /// Blobs that were missing or damaged.
    again: BTreeSet<Digest>,
}

/// The log has signed another history, or more of this one. A restart cannot help, so the exit code is 2.
#[derive(Debug)]
pub struct OtherHistory(String);

impl OtherHistory {
    /// States what is wrong and what helps.
    pub fn of(what: &str) -> Self {
        Self(format!(
            "{what}. Either its folder came back from an earlier state, or another aggregator runs on a copy of it. Stop the other one; restore the newest backup with `zk0 ledger restore`, or copy what is published with `zk0 ledger import`"
        ))
    }

    /// The same for what a witness has cosigned. It may also be the witness that is wrong.
    pub fn of_witness() -> Self {
        let Self(helps) = Self::of("the ledger does not go on from what a witness has cosigned");
        Self(format!(
            "{helps}. If you know that neither is so, the witness is wrong, or has cosigned what a thief of the log's key signed: start with `--ignore-witness NAME`, and vote for another witness"
        ))
    }

    /// The log in the blob store is not that of the ledger. The cause has what helps.
    pub fn in_store() -> Self {
        Self("the ledger is not served, because it and its blob store do not hold one log".into())
    }

    /// A former key of the log has signed what is published, so it is no reason to restore anything.
    fn of_former_key(what: &str) -> Self {
        Self(format!(
            "{what}. A former key of the log has signed that, and may be stolen: change who may write there, remove what is there, and start again, which publishes the log anew"
        ))
    }
}

impl fmt::Display for OtherHistory {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl LogStoreOptions {
    /// Opens the store for the log of the ledger in `dir`, if wanted.
    ///
    /// # Errors
    /// The address or the credentials are wrong, the store does not answer, or it is the blobs' store.
    pub fn open(
        &self,
        dir: &Path,
        blobs: &Blobs,
        store: &BlobStoreOptions,
    ) -> Result<Option<LogStore>> {
        let Some(address) = &self.log_store else {
            return Ok(None);
        };
        let private = blobs.store_address().unwrap_or_default();
        if format!("{private}/").starts_with(&format!("{}/", address.trim_end_matches('/'))) {
            bail!(
                "--log-store {address} would publish the blob store {private}, which also holds what is not public: use another bucket or prefix"
            );
        }
        Ok(Some(LogStore {
            dir: dir.into(),
            blobs: blobs.clone(),
            place: store.public_log(address)?,
            before: None,
            named: BTreeSet::new(),
            again: BTreeSet::new(),
        }))
    }
}

impl LogStore {
    /// Refuses a ledger that does not continue the store's: it is an old copy, or another aggregator runs on a copy. It would sign a second
    /// history.
    pub fn check(&self, ledger: &Ledger) -> Result<()> {
        let Some(text) = self.place.checkpoint(MAX_NOTE_BYTES as u64 + 1)? else {
            return Ok(());
        };
        let (name, dir) = (self.place.name(), self.dir.display());
        let key = ledger.state().genesis().verifier_key()?;
        let there = WitnessPolicy::none().open(&text, &key).with_context(|| {
            format!("the checkpoint in --log-store {name} is not one of this log: use another bucket or prefix")
        })?;
        ledger
            .reader()
            .continues(&there.checkpoint)
            .with_context(|| {
                let what =
                    format!("the ledger in {dir} does not go on from what is published in {name}");
                match ledger.state().log_keys().is_former(&there.key) {
                    true => OtherHistory::of_former_key(&what),
                    false => OtherHistory::of(&what),
                }
            })
    }

    /// Writes what is published until `stopped`, then the rest, however long the store takes. `service` shows trouble.
    pub async fn follow(mut self, service: Service, mut stopped: oneshot::Receiver<()>) {
        service.metrics().log_store_holds(0);
        let (mut wait, mut reported) = (TICK, None);
        loop {
            let ended = tokio::select! {
                _ = &mut stopped => true,
                () = sleep(wait) => false,
            };
            let writing = spawn_blocking(move || {
                let written = self.write();
                (self, written)
            });
            let (this, written) = match writing.await {
                Ok(done) => done,
                // The supervisor of this task sees it.
                Err(ended) => match ended.try_into_panic() {
                    Ok(panic) => resume_unwind(panic),
                    Err(_) => return,
                },
            };
            self = this;
            let trouble = written.as_ref().err().map(trouble);
            service.troubles().only(&OF_STORE, trouble);
            wait = match written {
                Ok(()) => {
                    reported = None;
                    service.metrics().log_store_holds(self.published());
                    TICK
                }
                Err(error) => {
                    let why = format!("{error:#}");
                    if reported.as_ref() != Some(&why) {
                        tracing::error!("the log is not published in its store: {why}; this is tried again every {RETRY:?}");
                        reported = Some(why);
                    }
                    RETRY
                }
            };
            if ended {
                return;
            }
        }
    }

    fn published(&self) -> u64 {
        let written = self.before.as_ref();
        written.map_or(0, |view| view.checkpoint().size)
    }

    fn write(&mut self) -> Result<()> {
        if let Some(before) = &self.before {
            if before.is_current()? {
                return Ok(());
            }
        }
        let view = match Publication::open(&self.dir, self.before.as_ref()) {
            Err(PublicationError::NotCosigned(_)) => return Ok(()),
            view => view?.with_blobs(self.blobs.clone()),
        };
        let done = match self.before {
            Some(_) => export_new(&view, &self.again, &mut self.place)?,
            None => export_to(&view, &mut self.place)?,
        };
        // Each checkpoint finds the same blobs: each is logged once.
        for damaged in &done.damaged {
            if !self.named.contains(&damaged.blob) {
                tracing::error!("a blob is not published in the log's store: {damaged}. It then follows with the next checkpoint");
            }
        }
        self.named = done.damaged.iter().map(|damaged| damaged.blob).collect();
        self.again = done.again;
        tracing::info!(
            entries = done.entries,
            tiles = done.tiles,
            blobs = done.blobs,
            "the log is published in its store"
        );
        self.before = Some(view);
        Ok(())
    }
}

/// The status's sentence. Only the log names the address.
fn trouble(error: &anyhow::Error) -> (Kind, &'static str) {
    match error.downcast_ref() {
        Some(
            ExportError::Other { .. }
            | ExportError::Ledger(LedgerError::RolledBack { .. } | LedgerError::Forked { .. }),
        ) => (
            Kind::Fork,
            "the store of the log holds another history than the ledger, or a newer one; the log of the aggregator states which",
        ),
        _ => (
            Kind::LogStore,
            "the newest entries cannot be written to the store of the log; the log of the aggregator states why",
        ),
    }
}
