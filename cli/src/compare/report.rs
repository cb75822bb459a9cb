//! A comparison's results: JSON, a figure, and tables.

use crate::chart::{self, Band, DifferenceRow};
use crate::compare::kept::write_json;
use crate::compare::options::CompareOptions;
use crate::compare::search::{in_words, SearchReport};
use crate::output::println;
use anyhow::Result;
use serde::Serialize;
use std::path::Path;
use zk0_protocol::counted::counted;
use zk0_simulate::compare::interval::{Interval, CONFIDENCE};
use zk0_simulate::compare::run::{ComparisonSetting, Run};
use zk0_simulate::compare::summary::{summary, ComparisonSummary, Difference};
use zk0_simulate::compare::variant::{Hyperparameters, SameSteps, Variant, VariantKind};

/// `comparison.json`.
#[derive(Serialize)]
struct ComparisonReport<'a> {
    /// Always false: a comparison proves nothing.
    proven: bool,
    confidence: f64,
    seeds: u64,
    first_seed: u64,
    rounds: u64,
    steps_in_a_round_and_node: usize,
    same_steps: SameSteps,
    variants: Vec<TrainedVariant<'a>>,
    nodes: Vec<NodeRecordings<'a>>,
    unseen: Vec<&'a str>,
    #[serde(flatten)]
    summary: ComparisonSummary,
    search: Option<SearchReport>,
}

#[derive(Serialize)]
struct TrainedVariant<'a> {
    variant: &'static str,
    /// For one seed: of all nodes, or of one machine.
    steps: u64,
    values: &'a Hyperparameters,
}

#[derive(Serialize)]
struct NodeRecordings<'a> {
    name: &'a str,
    recordings: &'a [String],
    frames_trained_on: usize,
    frames_measured_on: usize,
    held_out_episodes: &'a [String],
}

/// Writes and prints the results.
pub fn report(
    options: &CompareOptions,
    setting: &ComparisonSetting,
    values: &[Hyperparameters],
    runs: &[Run],
    search: Option<SearchReport>,
) -> Result<()> {
    let out = &options.out;
    let summary = summary(runs, &setting.nodes, &setting.unseen)?;
    print(&summary, options.seeds);
    draw(&out.join("comparison"), &summary)?;
    let variants = [Variant::Federated, Variant::Centralised, Variant::Alone(0)];
    let steps = |variant: Variant| {
        let run = runs.iter().find(|run| run.variant == variant);
        run.map_or(0, |run| run.steps)
    };
    let trained = variants.into_iter().zip(values).map(|(variant, values)| {
        let (kind, steps) = (variant.kind().name(), steps(variant));
        (kind, steps, values)
    });
    println!();
    for (kind, steps, values) in trained.clone() {
        let each = if kind == VariantKind::Alone.name() {
            " each"
        } else {
            ""
        };
        let steps = counted(steps, "step", "steps");
        println!("{kind:<12} {steps}{each}, {}", in_words(values)?);
    }
    let nodes = setting.nodes.iter().map(|node| NodeRecordings {
        name: &node.name,
        recordings: &node.recordings,
        frames_trained_on: node.trained_on.len(),
        frames_measured_on: node.evaluated.len(),
        held_out_episodes: &node.held_out,
    });
    let report = ComparisonReport {
        proven: false,
        confidence: CONFIDENCE,
        seeds: options.seeds,
        first_seed: options.federation.seed,
        rounds: setting.rounds,
        steps_in_a_round_and_node: setting.training.steps,
        same_steps: setting.same_steps,
        variants: trained
            .map(|(variant, steps, values)| TrainedVariant {
                variant,
                steps,
                values,
            })
            .collect(),
        nodes: nodes.collect(),
        unseen: setting.unseen.iter().map(|one| &one.name[..]).collect(),
        summary,
        search,
    };
    write_json(&out.join("comparison.json"), &report)
}

fn draw(stem: &Path, summary: &ComparisonSummary) -> Result<()> {
    let ends = |interval: &Interval| [interval.low, interval.mean, interval.high];
    let bands = summary.progress.iter().map(|progress| Band {
        name: progress.variant.into(),
        points: progress
            .points
            .iter()
            .map(|(round, loss)| (*round as f64, ends(loss)))
            .collect(),
    });
    let rows = summary.differences.iter().chain(&summary.each_node);
    let rows = rows.map(|one| DifferenceRow {
        name: format!("{}: minus {}", one.on, one.federated_minus),
        low: one.difference.low,
        mean: one.difference.mean,
        high: one.difference.high,
    });
    let (bands, rows): (Vec<_>, Vec<_>) = (bands.collect(), rows.collect());
    chart::draw_comparison(stem, &bands, &rows)
}

fn print(summary: &ComparisonSummary, seeds: u64) {
    println!("\nloss at the end: mean of {seeds} seeds, and its 95 % interval");
    let kinds = VariantKind::ALL
        .map(|kind| format!("{:<26}", kind.name()))
        .concat();
    println!("{:<44}{}", "measured on", kinds.trim_end());
    for row in summary.losses.chunks(VariantKind::ALL.len()) {
        let on = row.first().map_or("", |loss| &loss.on[..]);
        let losses = row.iter().map(|loss| {
            let Interval { mean, low, high } = loss.loss;
            format!("{:<26}", format!("{mean:.4} [{low:.4}, {high:.4}]"))
        });
        let losses: String = losses.collect();
        println!("{on:<44}{}", losses.trim_end());
    }
    println!("\nfederated minus the others, seed by seed: below 0, the federation is better");
    let all = summary.differences.iter().chain(&summary.each_node);
    for one in all {
        println!("{}", line(one));
    }
}

fn line(one: &Difference) -> String {
    let Interval { mean, low, high } = one.difference;
    let interval = format!("{mean:+.4} [{low:+.4}, {high:+.4}]");
    format!(
        "{:<44}minus {:<16}{interval:<30}{}",
        one.on,
        one.federated_minus,
        one.shows.text()
    )
}
