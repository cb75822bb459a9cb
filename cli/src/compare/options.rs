//! The options of `zk0 compare`.

use crate::simulate::federation_options::{strategy, FederationOptions};
use anyhow::{bail, Result};
use serde_json::json;
use std::path::PathBuf;
use std::time::Duration;
use zk0_protocol::rules::network_rules::Strategy;
use zk0_simulate::compare::search::Space;
use zk0_simulate::compare::variant::{Hyperparameters, SameSteps};
use zk0_simulate::robots::data::Dealing;

/// Compare federated training with centralised training on the frames of all nodes, and with each node alone, over several seeds, without proofs.
/// Losses are measured on held-out episodes and on unseen recordings. The folder `--out` gets `comparison.json`, `comparison.svg` and
/// `comparison.png`.
#[derive(Debug, clap::Args)]
pub struct CompareOptions {
    #[command(flatten)]
    pub federation: FederationOptions,
    /// Train with this many seeds: `--seed` and those that follow it. The held-out episodes are the same for all of them.
    #[arg(long, default_value_t = 5, value_name = "COUNT", value_parser = clap::value_parser!(u64).range(2..=1000))]
    pub seeds: u64,
    /// Let each node hold out this share of its episodes, at least one. Nobody trains on them.
    #[arg(long, default_value_t = 0.2, value_name = "SHARE")]
    eval_episodes: f64,
    /// Let centralised training make as many steps as all nodes together (total), or as one node (node).
    #[arg(long, default_value = "total", value_name = "AS", value_parser = same_steps)]
    pub same_steps: SameSteps,
    /// Choose learning rates, FedProx's mu and the strategy before the comparison, on validation episodes: each node sets aside one share more of its
    /// episodes for that. The values that the other options give are tried first. Centralised training and nodes alone get as many trials.
    #[arg(long)]
    pub search: bool,
    /// Let the search make this many trials of each: the federation, centralised training, and nodes alone.
    #[arg(long, default_value_t = 12, value_name = "COUNT", value_parser = clap::value_parser!(u64).range(1..=10_000))]
    pub search_trials: u64,
    /// End the search when it has taken this many minutes, however many trials it has made. The time of an earlier call does not count.
    #[arg(long, value_name = "MINUTES")]
    search_minutes: Option<f64>,
    /// Let the search try learning rates from `--learning-rate` divided by this factor to `--learning-rate` times this factor.
    #[arg(long, default_value_t = 10.0, value_name = "FACTOR")]
    search_factor: f64,
    /// Let the search try this mu of FedProx, besides `--fedprox-mu`. Repeat the option for more [default: 0, 0.001, 0.01, 0.1 and 1]
    #[arg(long, value_name = "MU")]
    search_mu: Vec<f64>,
    /// Let the search try this strategy, besides `--strategy`. Repeat the option for more [default: fed-avg, median, FedAvgM and FedAdam]
    #[arg(long, value_name = "STRATEGY", value_parser = strategy)]
    search_strategy: Vec<Strategy>,
    /// Write the results into this folder.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Go on with the comparison in `--out`: what it has finished is not done again. More seeds than before are possible; everything else has to
    /// be as it was.
    #[arg(long)]
    pub resume: bool,
}

fn same_steps(given: &str) -> Result<SameSteps, String> {
    match given {
        "total" => Ok(SameSteps::Total),
        "node" => Ok(SameSteps::Node),
        _ => Err("this is total or node".into()),
    }
}

impl CompareOptions {
    /// Refuses invalid options.
    pub fn check(&self) -> Result<()> {
        if !(self.eval_episodes > 0.0 && self.eval_episodes < 1.0) {
            bail!(
                "--eval-episodes is {}; a comparison needs held-out episodes, so it has to be above 0 and less than 1",
                self.eval_episodes
            );
        }
        if !(self.search_factor >= 1.0 && self.search_factor <= 1e6) {
            bail!(
                "--search-factor is {}; it has to be from 1 to 1000000",
                self.search_factor
            );
        }
        let minutes = self.search_minutes.unwrap_or(1.0);
        if !(minutes > 0.0 && minutes <= 1e6) {
            bail!("--search-minutes is {minutes}; it has to be above 0 and at most 1000000");
        }
        let mus = self.search_mu.iter().chain([&self.federation.fedprox_mu]);
        if let Some(mu) = mus.into_iter().find(|mu| !(**mu >= 0.0 && mu.is_finite())) {
            bail!("mu of FedProx is {mu}; it has to be 0 or above");
        }
        Ok(())
    }

    /// The time limit of the search.
    pub fn search_time(&self) -> Duration {
        let minutes = self.search_minutes;
        minutes.map_or(Duration::MAX, |minutes| {
            Duration::from_secs_f64(60.0 * minutes)
        })
    }

    /// The nodes' data in the comparison.
    pub fn dealing(&self) -> Dealing {
        self.federation.dealing(self.eval_episodes)
    }

    /// The nodes' data in the search, without the comparison's held-out episodes.
    pub fn searching(&self) -> Dealing {
        Dealing {
            set_aside: self.eval_episodes,
            ..self.dealing()
        }
    }

    /// What the search tries; without a search, the given values.
    pub fn space(&self) -> Space {
        let federation = &self.federation;
        let mut mus = if self.search_mu.is_empty() {
            vec![0.0, 0.001, 0.01, 0.1, 1.0]
        } else {
            self.search_mu.clone()
        };
        let mut strategies = if self.search_strategy.is_empty() {
            usual_strategies()
        } else {
            self.search_strategy.clone()
        };
        if !mus.contains(&federation.fedprox_mu) {
            mus.push(federation.fedprox_mu);
        }
        if !strategies.contains(&federation.strategy) {
            strategies.push(federation.strategy);
        }
        Space {
            given: Hyperparameters {
                learning_rate: federation.learning_rate,
                fedprox_mu: Some(federation.fedprox_mu),
                strategy: Some(federation.strategy),
            },
            factor: self.search_factor,
            mus,
            strategies,
        }
    }

    /// What decides each run's results, besides recordings and weights.
    pub fn identity(&self) -> String {
        let federation = &self.federation;
        let search = self.search.then(|| (self.space(), self.search_trials));
        let identity = json!([
            federation.strategy,
            federation.training(),
            federation.rounds,
            federation.starts_at_random(),
            self.dealing(),
            self.same_steps,
            search,
        ]);
        identity.to_string()
    }
}

fn usual_strategies() -> Vec<Strategy> {
    vec![
        Strategy::FedAvg,
        Strategy::Median,
        Strategy::FedAvgM {
            server_rate_bps: 10_000,
            momentum_bps: 5_000,
        },
        Strategy::FedAdam {
            server_rate_billionths: 1_000_000,
            beta1_bps: 9_000,
            beta2_bps: 9_900,
            tau_billionths: 1_000_000,
        },
    ]
}
