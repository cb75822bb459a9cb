//! `zk0 export check`: compares a policy folder with a ledger.

use super::closing::ClosingProof;
use super::receipt::ExportReceipt;
use crate::ledger::TrustOptions;
use crate::output::println;
use crate::policy::network_folder::{founded_with, other_tensors};
use anyhow::Result;
use std::path::PathBuf;
use zk0_audit::fetch::{locate, WantedBlobs};
use zk0_audit::log_source::Trust;
use zk0_circuits::EvalSpec;
use zk0_ledger::blobs::Blobs;
use zk0_lerobot::policy_folder::PolicyFolder;
use zk0_smolvla::Policy;
use zk0_weights::Format;

/// `zk0 export check`.
#[derive(Debug, clap::Args)]
pub struct ExportCheckOptions {
    /// The policy folder.
    folder: PathBuf,
    /// The ledger's folder or a copy of it, an export, or the address of a served log. The latter two are fetched into a temporary folder first.
    ledger: String,
    #[command(flatten)]
    trust: TrustOptions,
}

/// Compares them. Returns `false` if the folder does not hold its receipt's policy.
pub fn run(options: &ExportCheckOptions) -> Result<bool> {
    let receipt = ExportReceipt::read(&options.folder)?;
    let trust = options.trust.read()?;
    let located = locate(&options.ledger, None, &trust, WantedBlobs::Everything)?;
    let closing = ClosingProof::find(&located.dir, &Trust { ca: None, ..trust }, receipt.round)?;
    let wrong = wrong(options, &receipt, &closing, &Blobs::at(&located.dir))?;
    for what in &wrong {
        println!("FAILED       {what}");
    }
    if wrong.is_empty() {
        println!("network      {}", receipt.network);
        println!(
            "round        {}, closed by entry {}",
            receipt.round, receipt.entry
        );
        println!("VERIFIED     the folder holds the policy after that round. No proof was checked: `zk0 audit replay` does that");
    }
    Ok(wrong.is_empty())
}

fn wrong(
    options: &ExportCheckOptions,
    receipt: &ExportReceipt,
    closing: &ClosingProof,
    blobs: &Blobs,
) -> Result<Vec<String>> {
    let mut wrong = Vec::new();
    let found = ExportReceipt::of(closing, &options.folder)?;
    for (what, reports, is) in [
        ("network", &receipt.network, &found.network),
        ("log", &receipt.log, &found.log),
        (
            "entry",
            &receipt.entry.to_string(),
            &found.entry.to_string(),
        ),
        ("weights", &receipt.weights_sha256, &found.weights_sha256),
        (
            "founding policy",
            &receipt.policy_sha256,
            &found.policy_sha256,
        ),
    ] {
        if reports != is {
            wrong.push(format!(
                "the receipt states {what} {reports}, and the ledger states {is}"
            ));
        }
    }
    let names = receipt.files_sha256.keys().chain(found.files_sha256.keys());
    let names: std::collections::BTreeSet<_> = names.collect();
    for name in names {
        if receipt.files_sha256.get(name) != found.files_sha256.get(name) {
            wrong.push(format!(
                "the file {name} is not the one that the receipt names"
            ));
        }
    }
    let folder = PolicyFolder::open(&options.folder)?;
    if Policy::from_folder(&folder)?.frozen != founded_with(&closing.genesis, blobs)?.frozen {
        wrong.push(
            "the weights that are not trained differ from those of the network's policy".into(),
        );
    }
    let format = Format::new(&EvalSpec::decode(&closing.genesis.evaluation)?)?;
    for name in other_tensors(&format, &folder, blobs, &closing.weights())? {
        wrong.push(format!("tensor {name} is not that of the round"));
    }
    Ok(wrong)
}
