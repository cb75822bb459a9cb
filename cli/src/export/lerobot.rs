//! `zk0 export lerobot`: the policy folder of a round.

use super::closing::ClosingProof;
use super::receipt::ExportReceipt;
use crate::dataset::RecordingName;
use crate::ledger::TrustOptions;
use crate::output::println;
use crate::policy::network_folder::NetworkFolder;
use anyhow::{bail, Context, Result};
use std::fs;
use std::path::{Path, PathBuf};
use zk0_audit::fetch::{locate, WantedBlobs};
use zk0_audit::log_source::Trust;
use zk0_ledger::blobs::Blobs;

/// `zk0 export lerobot`.
#[derive(Debug, clap::Args)]
pub struct ExportLeRobotOptions {
    /// The ledger's folder or a copy of it, an export, or the address of a served log. The latter two are fetched into a temporary folder first.
    ledger: String,
    /// The round: the weights are those that the network had when it closed.
    #[arg(long, value_name = "N")]
    round: u64,
    /// The policy folder that the network was founded with (`zk0 aggregator init --policy FOLDER`). Whatever is not trained is copied from it, the
    /// statistics for normalising included.
    #[arg(long, value_name = "FOLDER")]
    policy: PathBuf,
    /// Give the policy the statistics of this recording, which is one of the robot that is to use it (a LeRobotDataset folder, or
    /// hub:owner/name[@revision]). Without this option it keeps those of the founding folder, and a folder that has none is refused.
    #[arg(long, value_name = "RECORDING")]
    statistics_of: Option<RecordingName>,
    /// The policy folder to write. It must not exist.
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    #[command(flatten)]
    trust: TrustOptions,
}

/// Writes the folder.
pub fn run(options: &ExportLeRobotOptions) -> Result<()> {
    let out = &options.out;
    if out.exists() {
        bail!("{} exists already: choose another --out", out.display());
    }
    let (Some(parent), Some(name)) = (out.parent(), out.file_name().and_then(|name| name.to_str()))
    else {
        bail!("--out {} does not name a folder", out.display());
    };
    let parent = if parent == Path::new("") {
        Path::new(".")
    } else {
        parent
    };
    let trust = options.trust.read()?;
    let located = locate(&options.ledger, None, &trust, WantedBlobs::Everything)?;
    let closing = ClosingProof::find(&located.dir, &Trust { ca: None, ..trust }, options.round)?;
    let blobs = Blobs::at(&located.dir);
    let statistics_of = options.statistics_of.as_ref();
    let founding = NetworkFolder::open(&options.policy, &closing.genesis, &blobs, statistics_of)?;
    fs::create_dir_all(parent).with_context(|| format!("creating {}", parent.display()))?;
    founding.write(parent, name, &closing.weights(), |folder| {
        ExportReceipt::of(&closing, folder)?.write(&closing, folder)
    })?;
    println!("network      {}", closing.genesis.network_id());
    println!(
        "round        {}, closed by entry {}",
        options.round, closing.proof.index
    );
    println!("weights      {}", closing.weights());
    println!("written      {}", out.display());
    println!("No proof was checked: `zk0 audit replay` does that.");
    Ok(())
}
