//! The nodes and their network as a federation.

use crate::robots::data::NodeData;
use crate::robots::error::SimulationError;
use crate::robots::outcome::TrainedNode;
use crate::rounds::Federation;
use std::sync::Arc;
use zk0_circuits::{Digest, NodeId, QuantisedWeights};
use zk0_node::error::ParticipantError;
use zk0_node::exchanged_weights::Base;
use zk0_protocol::rules::closing::server_moments::ServerMoments;
use zk0_protocol::rules::network_rules::{Rules, Strategy};
use zk0_smolvla::frames::batch::SamplesInMemory;
use zk0_smolvla::measure::evaluate;
use zk0_smolvla::measure::fixed_point::quantise_weights;
use zk0_smolvla::train::{FedCm, TrainOptions, Trainer, TrainingSamples};
use zk0_smolvla::{ExpertWeights, PolicyConfig};
use zk0_verifier::combine::bases::Bases;
use zk0_verifier::combine::contributions::WeightedContribution;
use zk0_verifier::combine::optimizers::moments::Moments;
use zk0_verifier::combine::source;
use zk0_verifier::combine::strategy::combined;
use zk0_weights::{Format, Unread};

/// How nodes train in each round.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Training {
    /// Optimiser steps.
    pub steps: usize,
    /// Samples a step.
    pub batch_size: usize,
    /// Learning rate.
    pub learning_rate: f64,
    /// FedProx's pull towards the base.
    pub fedprox_mu: f64,
    /// FedCM: the node's own part of each step; 1 for all.
    pub fedcm_alpha: f64,
    /// For samples, noise and times; 0 for a network's.
    pub seed: u64,
}

/// Nodes with their data and strategy.
pub struct Robots {
    /// The policy's dimensions.
    pub config: PolicyConfig,
    format: Format,
    strategy: Strategy,
    training: Training,
    /// The nodes.
    pub nodes: Arc<[NodeData]>,
}

/// What the next round starts from.
pub struct GlobalState {
    /// The weights, in int16 and float32.
    pub base: Base,
    /// The last round's base; `None` before the first.
    pub earlier: Option<Base>,
    /// FedAdam's moments and their file.
    pub moments: Option<(ServerMoments, Vec<u8>)>,
    /// The last round's reports.
    pub trained: Vec<TrainedNode>,
}

/// A node's update and report.
pub struct Update {
    weights: QuantisedWeights,
    trained: TrainedNode,
}

impl Robots {
    /// Nodes of a network of these dimensions.
    ///
    /// # Errors
    /// There is no node, or no network accepts the strategy or the dimensions.
    pub fn new(
        config: PolicyConfig,
        format: Format,
        strategy: Strategy,
        training: Training,
        nodes: Arc<[NodeData]>,
    ) -> Result<Self, SimulationError> {
        let rules = Rules {
            strategy,
            ..Rules::default()
        };
        rules.check().map_err(SimulationError::Rules)?;
        if let Strategy::Scaffold(_) = strategy {
            let why =
                "SCAFFOLD is not simulated yet: its nodes compute control variates from a ledger";
            return Err(SimulationError::Rules(why.into()));
        }
        if nodes.is_empty() {
            return Err(SimulationError::Data("there are no nodes".into()));
        }
        Ok(Self {
            config,
            format,
            strategy,
            training,
            nodes,
        })
    }

    /// The format of weight files.
    pub fn format(&self) -> &Format {
        &self.format
    }

    /// The first round's start, rounded as in founding a network.
    ///
    /// # Errors
    /// A weight is too large for every scale.
    pub fn start(&self, expert: &ExpertWeights) -> Result<GlobalState, SimulationError> {
        let rounded =
            quantise_weights(self.format.spec(), expert).map_err(ParticipantError::from)?;
        Ok(GlobalState {
            base: Base::read(&self.format, &self.config, &self.format.write(&rounded))?,
            earlier: None,
            moments: None,
            trained: Vec::new(),
        })
    }

    /// The loss of weights on a node's evaluation samples.
    ///
    /// # Errors
    /// A sample does not fit the policy.
    pub fn loss(&self, data: &NodeData, weights: &ExpertWeights) -> Result<f64, SimulationError> {
        let pairs: Vec<_> = data.evaluated.iter().zip(&data.draws).collect();
        Ok(evaluate::evaluate(&self.config, weights, &pairs)?.loss())
    }

    fn trained(
        &self,
        round: u64,
        node: usize,
        global: &GlobalState,
    ) -> Result<Update, ParticipantError> {
        let (data, how) = (&self.nodes[node], &self.training);
        let options = TrainOptions {
            steps: how.steps,
            batch_size: how.batch_size,
            learning_rate: how.learning_rate,
            fedprox_mu: how.fedprox_mu,
            // A network's seed is the round's number.
            seed: round.wrapping_add(how.seed << 32),
            ..TrainOptions::default()
        };
        let samples = SamplesInMemory::new(&self.config, &data.trained_on)?;
        let base = &global.base;
        let mut trainer = Trainer::new(
            &self.config,
            &base.weights,
            TrainingSamples::Prepared(&samples),
            options,
        )?;
        if let Some(earlier) = &global.earlier {
            trainer.follow(&FedCm {
                alpha: how.fedcm_alpha,
                earlier: &earlier.weights,
            })?;
        }
        let mut trained = TrainedNode::of(data);
        while !trainer.is_done() {
            trained.stepped(&trainer.step()?);
        }
        let weights = base.update(&self.format, &self.config, trainer.weights()?)?;
        Ok(Update { weights, trained })
    }

    fn combined(
        &self,
        global: &GlobalState,
        updates: &[(usize, QuantisedWeights)],
    ) -> Result<(Vec<u8>, Option<(ServerMoments, Vec<u8>)>), SimulationError> {
        let sources: Vec<_> = updates
            .iter()
            .map(|(_, weights)| source::WeightsInMemory {
                format: &self.format,
                weights,
            })
            .collect();
        let given: Vec<_> = updates
            .iter()
            .zip(&sources)
            .map(|((node, _), weights)| WeightedContribution {
                node: id(*node),
                weight: 1,
                weights,
            })
            .collect();
        let bases = Bases {
            base: Some(global.base.quantised.clone()),
            earlier: global.earlier.as_ref().map(|base| base.quantised.clone()),
        };
        let file = self.format.write(&global.base.quantised);
        let unread = Unread::of(&self.format, &self.format.open(&file[..])?)?;
        let mut kept = Vec::new();
        let read_at = |_: &Digest, place: u64, buffer: &mut [u8]| {
            let all = global.moments.as_ref().map_or(&[][..], |(_, file)| file);
            let from = usize::try_from(place).unwrap_or(usize::MAX);
            let part = all.get(from..).and_then(|rest| rest.get(..buffer.len()));
            let part = part.ok_or("the moments end too early")?;
            buffer.copy_from_slice(part);
            Ok::<_, String>(())
        };
        let mut moments = match &global.moments {
            Some((before, _)) => Moments::from(*before, &read_at, &mut kept),
            None => Moments::afresh(&mut kept),
        };
        let made = combined(
            &self.format,
            &given,
            self.strategy,
            &bases,
            &unread,
            &mut moments,
        )?;
        let steps = moments.steps();
        let after = made.moments.map(|blob| {
            let steps = steps + 1;
            (ServerMoments { blob, steps }, kept)
        });
        Ok((made.file.into_bytes(), after))
    }
}

/// For strategies that break ties.
fn id(node: usize) -> NodeId {
    let mut id = [0; 32];
    id[24..].copy_from_slice(&(node as u64).to_be_bytes());
    NodeId(id)
}

impl Federation for Robots {
    type Global = GlobalState;
    type Update = Update;
    /// At 2 bytes a weight: some exact strategies need all.
    type Collected = (Vec<(usize, QuantisedWeights)>, Vec<TrainedNode>);
    type Error = SimulationError;

    fn train(
        &self,
        round: u64,
        node: usize,
        global: &GlobalState,
    ) -> Result<Update, SimulationError> {
        let trained = self.trained(round, node, global);
        trained.map_err(|error| SimulationError::Node {
            round,
            node: self.nodes[node].name.clone(),
            error: Box::new(error),
        })
    }

    fn begin(&self, _: &GlobalState) -> Self::Collected {
        Self::Collected::default()
    }

    fn add(
        &self,
        (updates, told): &mut Self::Collected,
        node: usize,
        update: Update,
    ) -> Result<(), SimulationError> {
        updates.push((node, update.weights));
        told.push(update.trained);
        Ok(())
    }

    fn combine(
        &self,
        global: GlobalState,
        (updates, trained): Self::Collected,
    ) -> Result<GlobalState, SimulationError> {
        let (file, moments) = self.combined(&global, &updates)?;
        Ok(GlobalState {
            base: Base::read(&self.format, &self.config, &file)?,
            earlier: Some(global.base),
            moments,
            trained,
        })
    }
}
