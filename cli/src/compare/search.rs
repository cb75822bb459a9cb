//! The search for values before a comparison, on validation episodes outside its report.

use crate::compare::kept::ComparisonFolder;
use crate::compare::options::CompareOptions;
use crate::compare::prepared::PreparedRuns;
use crate::output::println;
use anyhow::{bail, Result};
use std::time::Instant;
use zk0_node::progress::Progress;
use zk0_protocol::counted::counted;
use zk0_simulate::compare::run::ComparisonSetting;
use zk0_simulate::compare::search::{best, Space, Trial};
use zk0_simulate::compare::variant::{Hyperparameters, VariantKind};
use zk0_simulate::robots::error::SimulationError;
use zk0_simulate::rounds;
use zk0_smolvla::ExpertWeights;

/// No comparison has this seed.
const SEED: u64 = u32::MAX as u64;

/// What a search did.
#[derive(serde::Serialize)]
pub struct SearchReport {
    /// What it tried.
    pub space: Space,
    /// Each node's validation episodes.
    pub validation_episodes: Vec<Vec<String>>,
    /// In the order made.
    pub trials: Vec<Trial>,
}

/// Makes the missing trials, and returns each kind's values, in the order of [`VariantKind::ALL`].
pub fn search(
    options: &CompareOptions,
    prepared: &PreparedRuns,
    kept: &ComparisonFolder,
) -> Result<(Vec<Hyperparameters>, SearchReport)> {
    let space = options.space();
    let measured = vec![options.federation.rounds];
    let setting = prepared.setting(options, &options.searching(), measured)?;
    let count = match kept.searched()? {
        Some(count) => count,
        None => make(options, prepared, kept, &space, &setting)?,
    };
    let (mut values, mut trials) = (Vec::new(), Vec::new());
    for kind in VariantKind::ALL {
        let of_kind = kept.trials(kind, count)?;
        let Some(chosen) = best(&of_kind) else {
            let why = of_kind.first().and_then(|trial| trial.failed.clone());
            bail!(
                "{} of {} failed, so there is nothing to choose from. The first one: {}. Try smaller learning rates",
                counted(count, "trial", "trials"),
                kind.name(),
                why.unwrap_or_default()
            );
        };
        println!(
            "{:<12} chosen among {}, with the loss {:.4} on validation episodes: {}",
            kind.name(),
            counted(count, "trial", "trials"),
            chosen.loss.unwrap_or(f64::NAN),
            in_words(&chosen.values)?
        );
        values.push(chosen.values.clone());
        trials.extend(of_kind);
    }
    let episodes = setting.nodes.iter().map(|node| node.held_out.clone());
    let searched = SearchReport {
        space,
        validation_episodes: episodes.collect(),
        trials,
    };
    Ok((values, searched))
}

/// Equally many of each kind, until there are enough or the time is over.
fn make(
    options: &CompareOptions,
    prepared: &PreparedRuns,
    kept: &ComparisonFolder,
    space: &Space,
    setting: &ComparisonSetting,
) -> Result<u64> {
    let start = prepared.start(options, SEED)?;
    let clock = Instant::now();
    let mut progress = Progress::start("searching", options.search_trials);
    let mut made = 0;
    while made < options.search_trials && (made == 0 || clock.elapsed() < options.search_time()) {
        let missing = VariantKind::ALL.into_iter();
        let missing: Vec<_> = missing
            .filter(|kind| !kept.has_trial(*kind, made))
            .collect();
        rounds::parallel(missing.len(), prepared.threads, |number| {
            let kind = missing[number];
            // From disk, as after an interruption.
            let before = kept.trials(kind, made)?;
            let values = space.next(kind, options.federation.seed, &before);
            kept.keep_trial(made, &trial(kind, values, setting, &start)?)
        })?;
        made += 1;
        progress.reached(made);
    }
    kept.keep_searched(made)?;
    Ok(made)
}

/// Divergence is a result, too.
fn trial(
    kind: VariantKind,
    values: Hyperparameters,
    setting: &ComparisonSetting,
    start: &ExpertWeights,
) -> Result<Trial, SimulationError> {
    let (loss, failed) = match setting.own_loss(kind, &values, SEED, start) {
        Ok(loss) => (Some(loss), None),
        Err(error @ (SimulationError::Rules(_) | SimulationError::Data(_))) => return Err(error),
        Err(error) => (None, Some(error.to_string())),
    };
    Ok(Trial {
        kind,
        values,
        loss,
        failed,
    })
}

/// Values as options of the command.
pub fn in_words(values: &Hyperparameters) -> Result<String> {
    let mut words = format!("--learning-rate {}", values.learning_rate);
    if let Some(mu) = values.fedprox_mu {
        words += &format!(" --fedprox-mu {mu}");
    }
    if let Some(strategy) = values.strategy {
        let strategy = serde_json::to_string(&strategy)?;
        words += &format!(" --strategy '{}'", strategy.trim_matches('"'));
    }
    Ok(words)
}
