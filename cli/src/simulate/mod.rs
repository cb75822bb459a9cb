//! `zk0 simulate`: a federation on one machine, without proofs. A resumed run gives the same results, byte for byte.

mod curves;
pub mod federation_options;
mod options;
mod report;

pub use options::SimulateOptions;

use crate::output::println;
use anyhow::{bail, Context, Result};
use curves::CurveFiles;
use federation_options::StartingPoint;
use sha2::{Digest as _, Sha256};
use std::fs;
use std::time::Instant;
use zk0_circuits::{Digest, EvalSpec};
use zk0_node::progress::Progress;
use zk0_protocol::blob::blob_digest;
use zk0_protocol::counted::counted;
use zk0_simulate::robots::data::{deal, unseen, NodeData};
use zk0_simulate::robots::error::SimulationError;
use zk0_simulate::robots::federation::{GlobalState, Robots};
use zk0_simulate::robots::outcome::{Aggregated, EvaluationLoss, SimulatedRound};
use zk0_simulate::robots::saved;
use zk0_simulate::rounds;
use zk0_smolvla::measure::fixed_point::dims;
use zk0_smolvla::ExpertWeights;
use zk0_weights::Format;

const NOT_PROVEN: &str =
    "nothing in this simulation is proven, signed or recorded: `zk0 demo` and real networks do that";

/// Runs the command.
pub fn run(options: &SimulateOptions) -> Result<()> {
    let out = &options.out;
    fs::create_dir_all(out).with_context(|| format!("creating {}", out.display()))?;
    println!("{NOT_PROVEN}");
    let simulation = Simulation::prepare(options)?;
    let (done, mut global) = simulation.begin()?;
    let clock = Instant::now();
    let made = options.federation.rounds - done;
    let mut progress = Progress::start("simulating", made);
    for round in done..options.federation.rounds {
        global = simulation.round(round, global)?;
        progress.reached(round + 1 - done);
    }
    let history = report::read(out, options.federation.rounds)?;
    report::finish(out, &history)?;
    let lerobot = global.base.weights.to_safetensors()?;
    report::write(&out.join("global.safetensors"), &lerobot)?;
    let travelling = simulation.robots.format().write(&global.base.quantised);
    report::write(&out.join("global.weights"), &travelling)?;
    println!(
        "{} of {} in {:.1} s; the results are in {}\n{NOT_PROVEN}",
        counted(made, "round", "rounds"),
        counted(simulation.robots.nodes.len() as u64, "node", "nodes"),
        clock.elapsed().as_secs_f64(),
        out.display()
    );
    Ok(())
}

struct Simulation<'a> {
    options: &'a SimulateOptions,
    robots: Robots,
    unseen: Vec<NodeData>,
    /// The start, before rounding.
    expert: ExpertWeights,
    /// Of policy, recordings and options.
    of: Digest,
    threads: usize,
    curves: Option<CurveFiles>,
}

impl<'a> Simulation<'a> {
    fn prepare(options: &'a SimulateOptions) -> Result<Self> {
        options.check()?;
        let federation = &options.federation;
        let StartingPoint {
            file,
            recordings,
            unseen: others,
        } = federation.open()?;
        let config = file.policy.config.clone();
        let format = Format::new(&EvalSpec::new(dims(&config)?)).map_err(SimulationError::from)?;
        let dealing = options.dealing();
        let nodes = deal(&recordings, &file, &dealing)?;
        let unseen: Vec<_> = others
            .iter()
            .map(|one| unseen(one, &file, &dealing))
            .collect();
        let (strategy, training) = (federation.strategy, federation.training());
        let robots = Robots::new(config, format, strategy, training, nodes.into())?;
        let curves = options.curves(&robots, &unseen)?;
        let expert = file.policy.expert;
        let mut of = Sha256::new();
        of.update(
            robots
                .format()
                .write(&robots.start(&expert)?.base.quantised),
        );
        of.update(options.identity());
        for recorded in recordings.iter().chain(&others) {
            of.update(recorded.digest);
        }
        Ok(Self {
            options,
            robots,
            unseen,
            of: Digest(of.finalize().into()),
            threads: federation.threads(&expert),
            expert,
            curves,
        })
    }

    fn begin(&self) -> Result<(u64, GlobalState)> {
        let out = &self.options.out;
        if saved::exists(out) {
            if !self.options.resume {
                bail!(
                    "{} holds a simulation: add --resume to go on with it, or choose another --out",
                    out.display()
                );
            }
            let (rounds, global) = saved::read(out, self.of, &self.robots)?;
            if rounds > self.options.federation.rounds {
                bail!(
                    "{} holds a simulation of {rounds} rounds, and --rounds is {}: ask for as many or for more",
                    out.display(),
                    self.options.federation.rounds
                );
            }
            tracing::info!("the simulation goes on after round {rounds}");
            return Ok((rounds, global));
        }
        let start = self.robots.start(&self.expert)?;
        self.keep(0, &start, None)?;
        Ok((0, start))
    }

    fn round(&self, round: u64, global: GlobalState) -> Result<GlobalState> {
        let count = self.robots.nodes.len();
        let chosen = rounds::sample(
            count,
            self.options.share,
            self.options.federation.seed,
            round,
        );
        let before = global.base.weights.clone();
        let global = rounds::round(&self.robots, round, &chosen, global, self.threads)?;
        let moved = report::distance(&before, &global.base.weights);
        self.keep(round + 1, &global, Some(moved))?;
        Ok(global)
    }

    fn keep(&self, rounds: u64, global: &GlobalState, moved: Option<f64>) -> Result<()> {
        let weights = &global.base.weights;
        let all: Vec<&NodeData> = self.robots.nodes.iter().chain(&self.unseen).collect();
        let losses = rounds::parallel(all.len(), self.threads, |number| {
            self.robots.loss(all[number], weights)
        })?;
        let evaluated = all.iter().zip(&losses).map(|(data, loss)| EvaluationLoss {
            name: data.name.clone(),
            loss: *loss,
        });
        let mut nodes: Vec<_> = evaluated.collect();
        let unseen = nodes.split_off(self.robots.nodes.len());
        let round = SimulatedRound {
            round: rounds,
            proven: false,
            mean_loss: nodes.iter().map(|node| node.loss).sum::<f64>() / nodes.len() as f64,
            nodes,
            unseen,
            aggregated_client_metrics: Aggregated::of(&global.trained, moved.unwrap_or(0.0)),
            individual_client_metrics: global.trained.clone(),
            weights: blob_digest(&self.robots.format().write(&global.base.quantised)).to_string(),
        };
        report::keep(&self.options.out, &round)?;
        if let Some(curves) = &self.curves {
            curves.add(&round);
        }
        saved::keep(&self.options.out, self.of, rounds, &self.robots, global)?;
        tracing::debug!("round {rounds}: mean loss {:.4}", round.mean_loss);
        Ok(())
    }
}
