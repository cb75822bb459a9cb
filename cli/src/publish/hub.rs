//! `zk0 publish hub`: a round's policy on the Hugging Face Hub.

use crate::dataset::RecordingName;
use crate::hub::{publish, PublishTarget, Repository};
use crate::output::println;
use crate::policy::network_folder::NetworkFolder;
use crate::publish::model_card::CardOptions;
use crate::publish::round_facts::{Collector, RoundFacts};
use anyhow::{bail, Context, Result};
use std::path::{Path, PathBuf};
use zk0_audit::report::history;
use zk0_circuits::Digest;
use zk0_ledger::blobs::Blobs;
use zk0_ledger::replay::Severity;
use zk0_lerobot::hub::HubOptions;
use zk0_protocol::entries::genesis::Genesis;
use zk0_protocol::Body;

/// `zk0 publish hub`.
#[derive(Debug, clap::Args)]
pub struct Hub {
    /// The ledger's folder: of an aggregator, which may be running, or a mirror (`zk0 ledger import`).
    ledger: PathBuf,
    /// The round, counted from 0.
    #[arg(long, value_name = "N")]
    round: u64,
    /// The policy folder that the network was founded with. Whatever is not trained is copied from it.
    #[arg(long, value_name = "FOLDER")]
    policy: PathBuf,
    /// Give the policy the statistics of this recording, which is one of the robot that is to use it (a LeRobotDataset folder, or
    /// hub:owner/name[@revision]). Without this option it keeps those of the founding folder, and a folder that has none is refused.
    #[arg(long, value_name = "RECORDING")]
    statistics_of: Option<RecordingName>,
    /// The model's repository on the Hub. It is created if it is not there.
    #[arg(long, value_name = "OWNER/NAME")]
    repo_id: Repository,
    /// Make the repository private, if it is created.
    #[arg(long)]
    private: bool,
    /// Accept only the ledger of the network with this id.
    #[arg(long, value_name = "ID")]
    network: Option<Digest>,
    /// Write what would be published into this folder, which is new or empty, and publish nothing.
    #[arg(long, value_name = "FOLDER")]
    dry_run: Option<PathBuf>,
    #[command(flatten)]
    card: CardOptions,
}

impl Hub {
    /// Runs the command.
    pub(super) fn run(&self) -> Result<()> {
        let (round, to) = (self.round, &self.repo_id);
        if let Some(folder) = &self.dry_run {
            self.write(folder)?;
            println!(
                "round {round} is in {}; nothing was published",
                folder.display()
            );
            return Ok(());
        }
        // A missing token is named before minutes are spent.
        let target = target(to, self.private)?;
        let folder =
            tempfile::tempdir().context("a folder for the policy (TMPDIR states where)")?;
        self.write(folder.path())?;
        let published = publish(&target, folder.path(), &summary(round))?;
        let endpoint = &target.endpoint;
        match published.commit {
            Some(commit) => println!("round {round} is at {endpoint}/{to}, commit {commit}"),
            None => println!("{endpoint}/{to} has round {round} already"),
        }
        Ok(())
    }

    fn write(&self, folder: &Path) -> Result<()> {
        let (genesis, facts) = facts(&self.ledger, self.network.as_ref(), self.round)?;
        let blobs = Blobs::at(&self.ledger);
        let statistics_of = self.statistics_of.as_ref();
        let policy = NetworkFolder::open(&self.policy, &genesis, &blobs, statistics_of)?;
        policy.write_to(folder, &facts.weights)?;
        self.card.write(folder, &self.repo_id, &facts)
    }
}

/// The summary of a round's commit.
pub fn summary(round: u64) -> String {
    format!("Round {round}")
}

/// The repository on the environment's Hub, with its token or that of `hf auth login`.
///
/// # Errors
/// There is no token.
pub fn target(repository: &Repository, private: bool) -> Result<PublishTarget> {
    let HubOptions {
        endpoint, token, ..
    } = HubOptions::from_env()?;
    Ok(PublishTarget {
        private,
        ..PublishTarget::new(repository.clone(), Some(endpoint), token)?
    })
}

/// The genesis and the facts about `round` of the ledger in `dir`.
///
/// # Errors
/// The ledger is another network's or has faults, or the round has not closed.
pub fn facts(dir: &Path, network: Option<&Digest>, round: u64) -> Result<(Genesis, RoundFacts)> {
    let report = zk0_ledger::replay(dir, network, &mut ());
    let faults = report.findings.iter();
    let mut faults = faults.filter(|finding| finding.severity == Severity::Fault);
    if let Some(fault) = faults.next() {
        bail!(
            "{} is not published, because its entries do not hold: {}; `zk0 audit replay` states more",
            dir.display(),
            fault.text
        );
    }
    if let Some(unread) = &report.unread {
        bail!(
            "{} is not published, because it cannot be read to its end: {}",
            dir.display(),
            unread.text
        );
    }
    let root = report.root.unwrap_or_default();
    let (mut found, mut wrong) = (None, None);
    history::read(dir, report.entries, &root, |index, entry| {
        if let Body::Genesis(genesis) = &entry.body {
            match Collector::new(genesis, round) {
                Ok(collector) => found = Some((genesis.clone(), collector)),
                Err(error) => wrong = Some(error),
            }
        }
        if let Some((_, collector)) = &mut found {
            collector.observe(index, entry);
        }
    })?;
    if let Some(error) = wrong {
        return Err(error);
    }
    let found = found.with_context(|| format!("{} does not hold a ledger", dir.display()))?;
    Ok((found.0, found.1.facts()?))
}
