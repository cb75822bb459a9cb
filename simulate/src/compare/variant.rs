//! The variants of a comparison.

use crate::robots::data::NodeData;
use serde::{Deserialize, Serialize};
use zk0_protocol::rules::network_rules::Strategy;

/// Who trains on what.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Variant {
    /// All nodes, each on its own frames. Rounds combine their updates.
    Federated,
    /// One machine with the frames of all nodes.
    Centralised,
    /// The node with this number alone.
    Alone(usize),
}

impl Variant {
    /// All variants with this many nodes.
    pub fn all(nodes: usize) -> Vec<Self> {
        let alone = (0..nodes).map(Self::Alone);
        [Self::Federated, Self::Centralised]
            .into_iter()
            .chain(alone)
            .collect()
    }

    /// Its name.
    pub fn name(self, nodes: &[NodeData]) -> String {
        match self {
            Self::Federated => "federated".into(),
            Self::Centralised => "centralised".into(),
            Self::Alone(node) => format!("{} alone", nodes[node].name),
        }
    }

    /// Its kind.
    pub fn kind(self) -> VariantKind {
        match self {
            Self::Federated => VariantKind::Federated,
            Self::Centralised => VariantKind::Centralised,
            Self::Alone(_) => VariantKind::Alone,
        }
    }
}

/// Variants with the same values.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum VariantKind {
    /// The federation.
    Federated,
    /// Centralised training.
    Centralised,
    /// Each node alone.
    Alone,
}

impl VariantKind {
    /// All kinds, in the order of reports.
    pub const ALL: [Self; 3] = [Self::Federated, Self::Centralised, Self::Alone];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Federated => "federated",
            Self::Centralised => "centralised",
            Self::Alone => "alone",
        }
    }
}

/// How a kind of variant trains.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Hyperparameters {
    /// Learning rate.
    pub learning_rate: f64,
    /// FedProx's μ; `None` without a federation.
    pub fedprox_mu: Option<f64>,
    /// How updates are combined; `None` without a federation.
    pub strategy: Option<Strategy>,
}

/// What centralised training shares its number of steps with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SameSteps {
    /// All nodes together: the same number of gradients.
    Total,
    /// One node: the same number of steps in sequence.
    Node,
}

impl SameSteps {
    /// A variant's steps per round.
    pub fn in_a_round(self, variant: Variant, nodes: usize, steps: usize) -> usize {
        match (variant, self) {
            (Variant::Federated, _) | (Variant::Centralised, Self::Total) => nodes * steps,
            (Variant::Centralised, Self::Node) | (Variant::Alone(_), _) => steps,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn centralised_training_makes_the_steps_of_all_nodes_or_of_one() {
        let steps = |same: SameSteps, variant| same.in_a_round(variant, 5, 20);
        for same in [SameSteps::Total, SameSteps::Node] {
            assert_eq!(steps(same, Variant::Federated), 100);
            assert_eq!(steps(same, Variant::Alone(3)), 20);
        }
        assert_eq!(steps(SameSteps::Total, Variant::Centralised), 100);
        assert_eq!(steps(SameSteps::Node, Variant::Centralised), 20);
    }
}
