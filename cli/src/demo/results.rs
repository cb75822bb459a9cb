//! A demo's results: the audit's verdict, `metrics.json`, the chart, and `global.safetensors`.

use super::global_losses::{global, EvaluationRecording, GlobalLoss, GlobalWeights, RoundResult};
use super::process::Console;
use crate::chart::{self, Bars, Curve, ProvenLosses};
use crate::output::{print, println};
use anyhow::{bail, Context, Result};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;
use zk0_audit::report::verdict::{verdict, Audited};
use zk0_audit::verified_entries::verified_entries;
use zk0_circuits::model::spec::EvalSpec;
use zk0_circuits::{Digest, NodeId};
use zk0_files::atomic_file;
use zk0_ledger::blobs::Blobs;
use zk0_ledger::replay::Verdict;
use zk0_node::training_history::TrainingHistory;
use zk0_protocol::counted::counted;
use zk0_protocol::entries::entry::{Body, Entry};
use zk0_protocol::entries::signed::{Signed, Submission};

/// Steps averaged in each point.
const WINDOW: usize = 20;

#[derive(Serialize)]
struct DemoMetrics {
    network: String,
    contributions: Vec<ContributionResult>,
    global: Vec<RoundResult>,
    training: Vec<Curve>,
    audit: Audited,
}

#[derive(Serialize)]
struct ContributionResult {
    round: u64,
    node: String,
    accepted: bool,
    reason: Option<String>,
    dataset_samples: u64,
    /// SHA-256, its name among the blobs.
    proof: String,
    /// Proven if the claim was accepted.
    loss_before: Option<f64>,
    loss_after: Option<f64>,
}

/// Audits the ledger, and writes and prints the results.
pub fn finish(
    out: &Path,
    network: &Path,
    names: &[String],
    recordings: &[EvaluationRecording],
    console: &Console,
) -> Result<()> {
    let (entries, report) = verified_entries(network)?;
    print!("\n{}\n", verdict(&report));
    if report.verdict != Verdict::Verified {
        bail!("the audit did not verify everything; the lines above state why");
    }
    let Some(Body::Genesis(genesis)) = entries.first().map(|entry| &entry.body) else {
        bail!("the ledger has no genesis");
    };
    let spec = EvalSpec::decode(&genesis.evaluation)?;
    let contributions = contributions(&entries, &spec);
    let training = training_curves(&out.join("nodes"), names)?;
    let blobs = Blobs::at(network);
    let weights = GlobalWeights::of(genesis, &blobs)?;
    let global = global(&entries, genesis, &weights, recordings)?;
    if let Some(last) = global.last() {
        let last = weights.read(&last.weights.parse::<Digest>()?)?;
        atomic_file::replace(&out.join("global.safetensors"), &last.to_safetensors()?)
            .context("writing global.safetensors")?;
    }
    let proven: Vec<ProvenLosses> = contributions
        .iter()
        .filter(|contribution| contribution.accepted)
        .filter_map(|contribution| {
            Some(ProvenLosses {
                name: contribution.node.clone(),
                round: contribution.round,
                before: contribution.loss_before?,
                after: contribution.loss_after?,
            })
        })
        .collect();
    chart::draw(&out.join("loss"), &training, &proven, &global_bars(&global))?;
    summary(&contributions, &global);
    let accepted = contributions
        .iter()
        .filter(|contribution| contribution.accepted)
        .count();
    let refused = contributions.len() - accepted;
    let metrics = DemoMetrics {
        network: report.network.clone().unwrap_or_default(),
        contributions,
        global,
        training,
        audit: report,
    };
    atomic_file::replace(
        &out.join("metrics.json"),
        &serde_json::to_vec_pretty(&metrics)?,
    )
    .context("writing metrics.json")?;
    console.tell(&format!(
        "done: {} accepted, {refused} refused, and the ledger is verified; the results are in {}",
        counted(accepted as u64, "contribution", "contributions"),
        out.display()
    ));
    println!(
        "\nAudit it yourself:  zk0 audit replay {}",
        network.display()
    );
    if accepted == 0 || refused == 0 {
        bail!("the demo should end with an accepted contribution and a refused one");
    }
    Ok(())
}

fn contributions(entries: &[Entry], spec: &EvalSpec) -> Vec<ContributionResult> {
    let mut names: BTreeMap<NodeId, &str> = BTreeMap::new();
    let mut contributions = Vec::new();
    for entry in entries {
        match &entry.body {
            Body::NodeEnrolled(enrolled) => {
                names.insert(enrolled.node, &enrolled.name);
            }
            Body::ContributionAccepted(submission) => {
                contributions.push(contribution(submission, &names, spec, None));
            }
            Body::ContributionRejected { submission, reason } => {
                contributions.push(contribution(
                    submission,
                    &names,
                    spec,
                    Some(reason.to_string()),
                ));
            }
            _ => {}
        }
    }
    contributions
}

fn contribution(
    submission: &Signed<Submission>,
    names: &BTreeMap<NodeId, &str>,
    spec: &EvalSpec,
    reason: Option<String>,
) -> ContributionResult {
    let claim = &submission.statement.claim;
    let losses = claim.losses.means(spec);
    ContributionResult {
        round: claim.terms.round,
        node: names
            .get(&claim.terms.node)
            .map_or_else(|| claim.terms.node.to_string(), |name| (*name).to_owned()),
        accepted: reason.is_none(),
        reason,
        dataset_samples: claim.terms.dataset.samples,
        proof: submission.statement.proof.to_string(),
        loss_before: losses.map(|(before, _)| before),
        loss_after: losses.map(|(_, after)| after),
    }
}

/// Smoothed. Each curve spans all rounds.
fn training_curves(nodes: &Path, names: &[String]) -> Result<Vec<Curve>> {
    let mut curves = Vec::new();
    for name in names {
        let mut losses = Vec::new();
        for round in 0.. {
            let Some(history) = TrainingHistory::read(&nodes.join(name), round)? else {
                break;
            };
            losses.extend(history.losses);
        }
        if losses.is_empty() {
            continue;
        }
        let mean = |window: &[f32]| {
            window.iter().map(|loss| f64::from(*loss)).sum::<f64>() / window.len() as f64
        };
        let points = losses
            .chunks(WINDOW)
            .enumerate()
            .map(|(i, window)| ((i * WINDOW) as f64, mean(window)));
        curves.push(Curve {
            name: name.clone(),
            points: points.collect(),
        });
    }
    Ok(curves)
}

/// Groups are recordings. Bars are the first weights and each round's result.
fn global_bars(global: &[RoundResult]) -> Bars {
    let losses =
        |of: fn(&GlobalLoss) -> f64, one: &RoundResult| one.losses.iter().map(of).collect();
    let first = global.first();
    let start = first.map(|one| ("start".into(), losses(|loss| loss.before, one)));
    let after = |one: &RoundResult| {
        let name = format!("after round {}", one.round);
        (name, losses(|loss| loss.after, one))
    };
    Bars {
        caption: "Global weights".into(),
        unit: "mean squared error".into(),
        groups: first.map_or(Vec::new(), |one| {
            one.losses.iter().map(GlobalLoss::whose).collect()
        }),
        series: start.into_iter().chain(global.iter().map(after)).collect(),
    }
}

fn summary(contributions: &[ContributionResult], global: &[RoundResult]) {
    let loss = |loss: Option<f64>| loss.map_or("hidden".into(), |loss| format!("{loss:.4}"));
    for one in contributions {
        let (before, after) = (loss(one.loss_before), loss(one.loss_after));
        match &one.reason {
            None => println!(
                "round {}  {:<8} accepted  proven loss {before} -> {after}",
                one.round, one.node
            ),
            Some(reason) => println!(
                "round {}  {:<8} REFUSED   claimed {before} -> {after}: {reason}",
                one.round, one.node
            ),
        }
    }
    for one in global {
        println!(
            "round {}  global   average of {}",
            one.round,
            counted(one.contributors as u64, "update", "updates")
        );
        if let Some(recorded) = &one.recorded {
            let loss =
                |loss: Option<f64>| loss.map_or("overflow".into(), |loss| format!("{loss:.4}"));
            println!(
                "round {}  result   recorded loss on the public samples: {} -> {}, {}",
                one.round,
                loss(recorded.base),
                loss(recorded.result),
                recorded.verdict()
            );
        }
        for loss in &one.losses {
            println!(
                "round {}  {:<8} loss of the global weights on {}: {:.4} -> {:.4}",
                one.round,
                loss.whose(),
                loss.recording,
                loss.before,
                loss.after
            );
        }
    }
}
