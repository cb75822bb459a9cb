//! Simulations of exported policies in the report, which are not proven.

use crate::report::history;
use crate::report::page::HtmlPage;
use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};
use std::path::Path;
use zk0_circuits::Digest;
use zk0_files::bounded_file;
use zk0_protocol::entries::entry::Body;

/// The file that `scripts/rollout` writes.
const RESULTS: &str = "results.json";
/// Longest results read, in bytes. An episode takes 150.
const MAX_RESULTS: u64 = 16 << 20;

/// One run of `scripts/rollout`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Rollouts {
    /// The folder of its videos.
    pub folder: String,
    /// Its results.
    #[serde(flatten)]
    pub results: Results,
    /// Whether the policy's receipt names this network, the round, and the ledger's weights after it.
    pub of_this_ledger: bool,
}

/// The results of `scripts/rollout`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Results {
    /// The arm's task.
    pub task: String,
    /// The number of episodes.
    pub episodes: u64,
    /// The number of successes.
    pub successes: u64,
    /// The interval of the success rate.
    pub interval: ShareInterval,
    /// The policy.
    pub policy: RolloutPolicy,
}

/// An interval of shares from 0 to 1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ShareInterval {
    /// The confidence.
    pub confidence: f64,
    /// The low end.
    pub low: f64,
    /// The high end.
    pub high: f64,
}

/// A rollout's policy.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RolloutPolicy {
    /// SHA-256 of the weights; none for the scripted expert.
    pub model_sha256: Option<String>,
    /// The receipt of `zk0 export lerobot`.
    pub receipt: Option<ReceiptSummary>,
}

/// The part of a receipt to compare with the ledger.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ReceiptSummary {
    /// The network's id.
    pub network: String,
    /// The round.
    pub round: u64,
    /// SHA-256 of the int16 weights.
    pub weights_sha256: String,
}

impl Rollouts {
    /// Reads the results in `folder`, and compares their receipt with the first `size` entries of the ledger in `dir`, of the root `root`.
    ///
    /// # Errors
    /// `folder` has no results, or the ledger is unreadable.
    pub fn read(folder: &Path, dir: &Path, size: u64, root: &str) -> Result<Self> {
        let path = folder.join(RESULTS);
        let reading = || format!("reading {}", path.display());
        let bytes = bounded_file::read(&path, MAX_RESULTS).with_context(reading)?;
        let results: Results = serde_json::from_slice(&bytes).with_context(reading)?;
        let (mut network, mut weights): (Option<Digest>, Option<Digest>) = (None, None);
        let round = results.policy.receipt.as_ref().map(|receipt| receipt.round);
        history::read(dir, size, root, |_, entry| match &entry.body {
            Body::Genesis(genesis) => network = Some(genesis.network_id()),
            Body::RoundClosed(closed) if Some(closed.round) == round => {
                weights = Some(closed.global.blob);
            }
            _ => {}
        })?;
        let named = |digest: Option<Digest>, text: &str| {
            digest.is_some_and(|digest| digest.to_string() == text)
        };
        let of_this_ledger = results.policy.receipt.as_ref().is_some_and(|receipt| {
            named(network, &receipt.network) && named(weights, &receipt.weights_sha256)
        });
        Ok(Self {
            folder: folder.display().to_string(),
            results,
            of_this_ledger,
        })
    }
}

impl HtmlPage {
    /// The section of the rollouts, if any.
    pub(super) fn rollouts(&mut self, all: &[Rollouts]) {
        if all.is_empty() {
            return;
        }
        self.heading("Rollouts");
        self.markup(
            "<p><b>Not proven.</b> Whoever made this page states what a policy did in a simulation. The audit compared the receipt's network, round and weights \
             with the ledger, and nothing else of this section: not that the policy's files are what the receipt reports (zk0 export check does), nor \
             that the simulation ran as it reports.</p>",
        );
        let columns = [
            "#round",
            "task",
            "#succeeded",
            "interval",
            "receipt",
            "policy",
            "videos",
        ];
        self.table(&columns);
        for one in all {
            let results = &one.results;
            let receipt = results.policy.receipt.as_ref();
            let percent = |share: f64| format!("{:.0}", share * 100.0);
            let reports = match (receipt, one.of_this_ledger) {
                (None, _) => "none",
                (Some(_), true) => "the ledger's weights after that round",
                (Some(_), false) => "NOT the ledger's weights after that round",
            };
            self.row(
                &columns,
                &[
                    &receipt.map_or("–".into(), |receipt| receipt.round.to_string()),
                    &results.task,
                    &format!("{} of {}", results.successes, results.episodes),
                    &format!(
                        "{} % sure: {} to {} %",
                        percent(results.interval.confidence),
                        percent(results.interval.low),
                        percent(results.interval.high)
                    ),
                    &reports,
                    &results
                        .policy
                        .model_sha256
                        .as_deref()
                        .unwrap_or("scripted expert"),
                    &one.folder,
                ],
            );
        }
        self.end_table();
    }
}
