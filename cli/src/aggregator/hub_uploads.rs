//! `zk0 aggregator serve --hf-repo-id`: publishes policy folders on the Hugging Face Hub with a model card.
//!
//! The rounds do not wait for uploads. Failed uploads are logged and repeated, first after seconds, at last every ten minutes. What is left
//! at the end follows after the next start.

use super::checkpoints_folder::{note_published, published_in, round_folder, rounds};
use crate::hub::target::RetryPolicy;
use crate::hub::{publish, PublishTarget, Repository};
use crate::publish::model_card::CardOptions;
use crate::publish::round_facts::{Collector, RoundFacts};
use crate::publish::{summary, target};
use anyhow::{Context, Result};
use std::path::{Path, PathBuf};
use std::time::Duration;
use tokio::task::spawn_blocking;
use tokio::time::sleep;
use zk0_aggregator::{Aggregator, Service};
use zk0_circuits::NodeId;
use zk0_ledger::error::LedgerError;
use zk0_protocol::entries::genesis::Genesis;
use zk0_protocol::Entry;

const TICK: Duration = Duration::from_secs(1);
const WAITS: [Duration; 2] = [Duration::from_secs(5), Duration::from_secs(600)];

/// Whether and how policy folders are published.
#[derive(Debug, clap::Args)]
pub struct HubUploadOptions {
    /// Publish each policy folder of --checkpoint-interval as a commit of this model on the Hugging Face Hub, with a model card. HF_TOKEN holds a
    /// token that may write, or `hf auth login` has left one. HF_ENDPOINT names another Hub.
    #[arg(long, value_name = "OWNER/NAME", requires = "checkpoint_interval")]
    hf_repo_id: Option<Repository>,
    /// Make the model on the Hub private, if it is created.
    #[arg(long)]
    hf_private: bool,
    #[command(flatten)]
    card: CardOptions,
}

/// Publishes policy folders.
pub struct HubUploads {
    target: PublishTarget,
    card: CardOptions,
    folders: PathBuf,
    /// Earlier rounds are done.
    next: u64,
}

/// Read under the aggregator's lock.
struct OfRound {
    genesis: Genesis,
    names: Vec<(NodeId, String)>,
    entries: Vec<(u64, Entry)>,
}

impl HubUploadOptions {
    /// Opens the publisher of the policy folders in `folders`, if wanted.
    ///
    /// # Errors
    /// There is no token, or the folder cannot be read.
    pub fn open(&self, folders: Option<&Path>) -> Result<Option<HubUploads>> {
        let (Some(repository), Some(folders)) = (&self.hf_repo_id, folders) else {
            return Ok(None);
        };
        let target = PublishTarget {
            // `follow` counts the tries.
            patience: RetryPolicy {
                tries: 1,
                ..RetryPolicy::default()
            },
            ..target(repository, self.hf_private).context("--hf-repo-id")?
        };
        let newest = rounds(folders)?.last().copied();
        Ok(Some(HubUploads {
            next: published_in(folders, repository)?
                .map(|round| round + 1)
                .or(newest)
                .unwrap_or(0),
            target,
            card: self.card.clone(),
            folders: folders.into(),
        }))
    }
}

impl HubUploads {
    /// Publishes new folders while the aggregator runs.
    pub async fn follow(mut self, service: Service) {
        let mut pause = WAITS[0];
        loop {
            sleep(TICK).await;
            match self.upload_due(&service).await {
                Ok(()) => pause = WAITS[0],
                Err(error) => {
                    tracing::error!(
                        "a policy folder is not published on the Hub, and is tried again in {} s: {error:#}",
                        pause.as_secs()
                    );
                    sleep(pause).await;
                    pause = (pause * 2).min(WAITS[1]);
                }
            }
        }
    }

    async fn upload_due(&mut self, service: &Service) -> Result<()> {
        let due = rounds(&self.folders)?.into_iter();
        for round in due.filter(|round| *round >= self.next).collect::<Vec<_>>() {
            let facts = facts(service, round).await?;
            let (target, card) = (self.target.clone(), self.card.clone());
            let folder = round_folder(&self.folders, round);
            let upload = move || -> Result<_> {
                card.write(&folder, &target.repository, &facts)?;
                Ok(publish(&target, &folder, &summary(round))?)
            };
            spawn_blocking(upload).await??;
            let PublishTarget {
                endpoint,
                repository,
                ..
            } = &self.target;
            tracing::info!(round, "published at {endpoint}/{repository}");
            self.next = round + 1;
            note_published(&self.folders, repository, round)?;
        }
        Ok(())
    }
}

async fn facts(service: &Service, round: u64) -> Result<RoundFacts> {
    let read = move |aggregator: &mut Aggregator| {
        let (state, ledger) = (aggregator.state(), aggregator.ledger());
        let entries = aggregator.round(Some(round), ledger.size());
        let ends = entries.and_then(|entries| Some(entries.opened..entries.closed? + 1));
        let of_round = OfRound {
            genesis: state.genesis().clone(),
            names: (state.nodes().iter())
                .map(|(id, node)| (*id, node.name.clone()))
                .collect(),
            entries: Vec::new(),
        };
        Ok((of_round, ends.unwrap_or(0..0), ledger.reader().clone()))
    };
    let (mut of_round, indices, ledger) = service.with(read).await?;
    let entries = move || -> Result<_, LedgerError> {
        let entry = |index| -> Result<_, LedgerError> { Ok((index, ledger.entry(index)?)) };
        indices.map(entry).collect()
    };
    of_round.entries = spawn_blocking(entries).await??;
    let mut collector = Collector::new(&of_round.genesis, round)?;
    for (node, name) in &of_round.names {
        collector.named(*node, name);
    }
    for (index, entry) in &of_round.entries {
        collector.observe(*index, entry);
    }
    collector.facts()
}
