//! A round's results, as `round_N.json`. Fields of the Python zk0 keep its names.

use crate::robots::data::NodeData;
use serde::{Deserialize, Serialize};
use zk0_smolvla::train::TrainingStep;

/// A node's report on a round.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrainedNode {
    /// The node's name.
    pub client_id: String,
    /// Its recordings.
    pub dataset_name: String,
    /// The frames it trains on.
    pub num_examples: usize,
    /// The mean loss of its steps.
    pub loss: f64,
    /// The mean of FedProx's term.
    pub fedprox_loss: f64,
    /// The mean gradient norm, before clipping.
    pub grad_norm: f64,
    /// The mean learning rate.
    #[serde(skip)]
    pub learning_rate: f64,
    #[serde(skip)]
    steps: usize,
}

impl TrainedNode {
    /// Before any step.
    pub fn of(data: &NodeData) -> Self {
        Self {
            client_id: data.name.clone(),
            dataset_name: data.recordings.join(", "),
            num_examples: data.trained_on.len(),
            loss: 0.0,
            fedprox_loss: 0.0,
            grad_norm: 0.0,
            learning_rate: 0.0,
            steps: 0,
        }
    }

    /// After a step.
    pub fn stepped(&mut self, step: &TrainingStep) {
        self.steps += 1;
        let part = 1.0 / self.steps as f64;
        let mean = |mean: &mut f64, value: f64| *mean += (value - *mean) * part;
        mean(&mut self.loss, step.loss.into());
        mean(&mut self.fedprox_loss, step.proximal);
        mean(&mut self.grad_norm, step.gradient_norm);
        mean(&mut self.learning_rate, step.learning_rate);
    }
}

/// A loss on a node's evaluation samples, or on an unseen recording.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EvaluationLoss {
    /// The node or the recording.
    pub name: String,
    /// The flow-matching loss, a mean squared error.
    pub loss: f64,
}

/// A round's reports together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Aggregated {
    /// The mean training loss.
    pub avg_client_loss: f64,
    /// Their standard deviation.
    pub std_client_loss: f64,
    /// The mean of FedProx's terms.
    pub avg_client_proximal_loss: f64,
    /// The mean gradient norm.
    pub avg_client_grad_norm: f64,
    /// The number of nodes in the round.
    pub num_clients: usize,
    /// Euclidean norm of the global weights' change.
    pub param_update_norm: f64,
}

/// A round. Round 0 is before any training.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SimulatedRound {
    /// Its number.
    pub round: u64,
    /// Always false: a simulation proves nothing.
    pub proven: bool,
    /// The mean loss over all nodes.
    pub mean_loss: f64,
    /// Loss on each node's evaluation samples.
    pub nodes: Vec<EvaluationLoss>,
    /// Loss on recordings that no node has.
    pub unseen: Vec<EvaluationLoss>,
    /// The reports together.
    pub aggregated_client_metrics: Option<Aggregated>,
    /// Each node's report.
    pub individual_client_metrics: Vec<TrainedNode>,
    /// SHA-256 of the global weights, as in the ledger.
    pub weights: String,
}

impl Aggregated {
    /// `None` if there are no reports.
    pub fn of(trained: &[TrainedNode], param_update_norm: f64) -> Option<Self> {
        if trained.is_empty() {
            return None;
        }
        let count = trained.len() as f64;
        let mean = |of: fn(&TrainedNode) -> f64| trained.iter().map(of).sum::<f64>() / count;
        let loss = mean(|one| one.loss);
        let squares = trained.iter().map(|one| (one.loss - loss).powi(2));
        Some(Self {
            avg_client_loss: loss,
            std_client_loss: (squares.sum::<f64>() / count).sqrt(),
            avg_client_proximal_loss: mean(|one| one.fedprox_loss),
            avg_client_grad_norm: mean(|one| one.grad_norm),
            num_clients: trained.len(),
            param_update_norm,
        })
    }
}
