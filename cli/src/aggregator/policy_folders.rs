//! `zk0 aggregator serve --checkpoint-interval N`: writes the global weights as a policy folder for LeRobot's `from_pretrained`, after
//! every N rounds and at the end.
//!
//! The rounds do not wait. A failure is logged, and it is tried again.

use super::checkpoints_folder;
use crate::dataset::RecordingName;
use crate::policy::network_folder::NetworkFolder;
use anyhow::{Context, Result};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::oneshot;
use tokio::task::spawn_blocking;
use tokio::time::sleep;
use zk0_aggregator::{Aggregator, Service};
use zk0_circuits::Digest;

const TICK: Duration = Duration::from_secs(1);

const RETRY: Duration = Duration::from_secs(60);

/// When and where policy folders are written.
#[derive(Debug, clap::Args)]
pub struct PolicyFolderOptions {
    /// Write the global weights as a policy folder, which LeRobot loads, after every N rounds and at the end.
    #[arg(long, value_name = "N", requires = "checkpoints", requires = "checkpoint_policy", value_parser = clap::value_parser!(u64).range(1..))]
    checkpoint_interval: Option<u64>,
    /// Write these policy folders into this folder, as round-0, round-1 and so on. One that exists is kept. A folder serves one network: the file
    /// `network` in it holds the network's id.
    #[arg(long, value_name = "FOLDER", requires = "checkpoint_interval")]
    checkpoints: Option<PathBuf>,
    /// The policy folder that the network was founded with (`zk0 aggregator init --policy FOLDER`). Whatever is not trained is copied from it.
    #[arg(long, value_name = "FOLDER", requires = "checkpoint_interval")]
    checkpoint_policy: Option<PathBuf>,
    /// Give these policy folders the statistics of this recording, which is one of a robot that is to use them (a LeRobotDataset folder, or
    /// hub:owner/name[@revision]). Without this option they keep those of the founding folder, and a folder that has none is refused.
    #[arg(long, value_name = "RECORDING", requires = "checkpoint_interval")]
    checkpoint_statistics_of: Option<RecordingName>,
}

/// Writes policy folders.
pub struct PolicyFolders {
    interval: u64,
    rounds: u64,
    writer: Arc<FolderWriter>,
    /// Earlier rounds are done.
    next: u64,
}

struct FolderWriter {
    out: PathBuf,
    folder: NetworkFolder,
}

impl PolicyFolderOptions {
    /// Where the folders go.
    pub fn out(&self) -> Option<&Path> {
        self.checkpoints.as_deref()
    }

    /// Opens the writer of policy folders, if wanted.
    ///
    /// # Errors
    /// The policy folder cannot be read or is not the founding one, or the folder of `--checkpoints` is another network's.
    pub fn open(&self, aggregator: &Aggregator, rounds: u64) -> Result<Option<PolicyFolders>> {
        let (Some(interval), Some(out), Some(policy)) = (
            self.checkpoint_interval,
            &self.checkpoints,
            &self.checkpoint_policy,
        ) else {
            return Ok(None);
        };
        let state = aggregator.state();
        let blobs = aggregator.ledger().blobs();
        let statistics_of = self.checkpoint_statistics_of.as_ref();
        let folder = NetworkFolder::open(policy, state.genesis(), blobs, statistics_of)?;
        let closed = closed_rounds(aggregator);
        let holds_weights = |round, copy: &Path| {
            let weights = state.results().of(round);
            let weights = weights.context("the ledger remembers the newest rounds only")?;
            folder.is_copy_with(copy, &weights.blob)
        };
        checkpoints_folder::keep_to(out, state.network(), closed, holds_weights)?;
        Ok(Some(PolicyFolders {
            interval,
            rounds,
            writer: Arc::new(FolderWriter {
                out: out.clone(),
                folder,
            }),
            // A kill may have left out the last one due.
            next: (closed - closed % interval).saturating_sub(1),
        }))
    }
}

impl PolicyFolders {
    /// Writes due folders until `stopped`, then the last one.
    pub async fn follow(mut self, service: Service, mut stopped: oneshot::Receiver<()>) {
        let mut wait = TICK;
        loop {
            let ended = tokio::select! {
                _ = &mut stopped => true,
                () = sleep(wait) => false,
            };
            wait = match self.write_due(&service, ended).await {
                Ok(()) => TICK,
                Err(error) => {
                    tracing::error!("a policy folder is not written: {error:#}");
                    RETRY
                }
            };
            if ended {
                return;
            }
        }
    }

    async fn write_due(&mut self, service: &Service, ended: bool) -> Result<()> {
        let (next, interval, rounds) = (self.next, self.interval, self.rounds);
        let due = move |aggregator: &mut Aggregator| {
            let closed = closed_rounds(aggregator);
            let last = ended || closed >= rounds;
            let due = (next..closed)
                .filter(|round| (round + 1) % interval == 0 || (last && round + 1 == closed));
            let results = aggregator.state().results();
            let due = due.filter_map(|round| Some((round, results.of(round)?.blob)));
            Ok((closed, due.collect::<Vec<_>>()))
        };
        let (closed, due) = service.with(due).await?;
        for (round, weights) in due {
            let writer = self.writer.clone();
            spawn_blocking(move || writer.write(round, &weights)).await??;
            self.next = round + 1;
        }
        // The round before the next one may be the last.
        self.next = self.next.max(closed.saturating_sub(1));
        Ok(())
    }
}

impl FolderWriter {
    fn write(&self, round: u64, weights: &Digest) -> Result<()> {
        // `open` refuses another network's folder.
        if checkpoints_folder::round_folder(&self.out, round).exists() {
            return Ok(());
        }
        let name = format!("round-{round}");
        let folder = self.folder.write(&self.out, &name, weights, |_| Ok(()))?;
        tracing::info!(round, "policy folder written: {}", folder.display());
        Ok(())
    }
}

fn closed_rounds(aggregator: &Aggregator) -> u64 {
    let state = aggregator.state();
    state.next_round() - u64::from(state.round().is_some())
}
