//! A simulation's results as files.

use crate::chart::{self, Curve};
use crate::output::println;
use anyhow::{Context, Result};
use std::path::{Path, PathBuf};
use zk0_files::{atomic_file, bounded_file};
use zk0_simulate::robots::outcome::SimulatedRound;
use zk0_smolvla::ExpertWeights;

/// A hundred thousand nodes take tens of megabytes.
const MAX_ROUND_BYTES: u64 = 256 << 20;

fn path(out: &Path, round: u64) -> PathBuf {
    out.join(format!("round_{round}.json"))
}

/// Writes `round_N.json`.
pub fn keep(out: &Path, round: &SimulatedRound) -> Result<()> {
    write(&path(out, round.round), &serde_json::to_vec_pretty(round)?)
}

/// Writes a file, whole or not at all.
pub fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    atomic_file::replace(path, bytes).with_context(|| format!("writing {}", path.display()))
}

/// Reads the rounds 0 to `rounds`.
pub fn read(out: &Path, rounds: u64) -> Result<Vec<SimulatedRound>> {
    let round = |number| {
        let path = path(out, number);
        let read = bounded_file::read(&path, MAX_ROUND_BYTES).map_err(anyhow::Error::from);
        let round = read.and_then(|bytes| Ok(serde_json::from_slice(&bytes)?));
        round.with_context(|| format!("reading {}", path.display()))
    };
    (0..=rounds).map(round).collect()
}

/// Draws the losses by round, and prints the first and the last.
pub fn finish(out: &Path, history: &[SimulatedRound]) -> Result<()> {
    let (Some(first), Some(last)) = (history.first(), history.last()) else {
        return Ok(());
    };
    let curve = |name: &str, loss: &dyn Fn(&SimulatedRound) -> f64| Curve {
        name: name.into(),
        points: history
            .iter()
            .map(|round| (round.round as f64, loss(round)))
            .collect(),
    };
    let mut curves = vec![curve("mean of the nodes", &|round| round.mean_loss)];
    for (place, node) in first.nodes.iter().enumerate() {
        curves.push(curve(&node.name, &|round| round.nodes[place].loss));
    }
    let nodes = 1..curves.len();
    for (place, one) in first.unseen.iter().enumerate() {
        let name = format!("{} (unseen)", one.name);
        curves.push(curve(&name, &|round| round.unseen[place].loss));
    }
    chart::draw_rounds(&out.join("loss"), &curves, nodes)?;
    let round = last.round;
    for curve in &curves {
        let loss = |point: Option<&(f64, f64)>| point.map_or(f64::NAN, |point| point.1);
        let (before, after) = (loss(curve.points.first()), loss(curve.points.last()));
        println!(
            "{:<32} loss of the global weights: {before:.4} -> {after:.4} in round {round}",
            curve.name
        );
    }
    Ok(())
}

/// The Euclidean distance of two sets of weights.
pub fn distance(before: &ExpertWeights, after: &ExpertWeights) -> f64 {
    let pairs = before.tensors().values().zip(after.tensors().values());
    let squares = pairs.flat_map(|(before, after)| {
        let pairs = before.data.iter().zip(&after.data);
        pairs.map(|(before, after)| f64::from(after - before).powi(2))
    });
    squares.sum::<f64>().sqrt()
}
