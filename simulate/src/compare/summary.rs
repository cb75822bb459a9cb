//! Sums up the runs of several seeds: means, and the federation's differences seed by seed.

use crate::compare::interval::Interval;
use crate::compare::run::{own, Run};
use crate::compare::variant::{Variant, VariantKind};
use crate::robots::data::NodeData;
use crate::robots::error::SimulationError;
use serde::Serialize;

/// A kind's loss.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Loss {
    /// What it is measured on.
    pub on: String,
    /// What trained: for `alone`, a mean over the nodes.
    pub variant: &'static str,
    /// The mean over the seeds.
    pub loss: Interval,
    /// One loss a seed.
    pub by_seed: Vec<f64>,
}

/// The federation's loss minus another's: below 0 where the federation is better.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Difference {
    /// What it is measured on.
    pub on: String,
    /// What the federation is compared with.
    pub federated_minus: String,
    /// The mean over the seeds.
    pub difference: Interval,
    /// One difference a seed.
    pub by_seed: Vec<f64>,
    /// The verdict.
    pub shows: FederationVerdict,
}

/// What an interval of differences shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum FederationVerdict {
    /// The interval lies below 0.
    FederationIsBetter,
    /// The interval lies above 0.
    FederationIsWorse,
    /// The interval holds 0.
    NoDifferenceShown,
}

/// Losses along the way, on own held-out episodes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LossProgress {
    /// What trained.
    pub variant: &'static str,
    /// Rounds, with means over the seeds.
    pub points: Vec<(u64, Interval)>,
}

/// The results of all runs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ComparisonSummary {
    /// The losses at the end.
    pub losses: Vec<Loss>,
    /// The federation against the others, on average over the nodes.
    pub differences: Vec<Difference>,
    /// The federation against each node alone.
    pub each_node: Vec<Difference>,
    /// The losses along the way.
    pub progress: Vec<LossProgress>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Measure {
    /// Held-out episodes of those that trained.
    Own,
    /// Held-out episodes of the others; of all if all trained.
    Others,
    /// The unseen recording with this number.
    Unseen(usize),
}

impl Measure {
    fn of(self, variant: &Variant, losses: &[f64], nodes: usize) -> f64 {
        match (self, variant) {
            (Self::Others, Variant::Alone(node)) => {
                let all: f64 = losses[..nodes].iter().sum();
                (all - losses[*node]) / (nodes - 1) as f64
            }
            (Self::Own | Self::Others, _) => own(variant, losses, nodes),
            (Self::Unseen(number), _) => losses[nodes + number],
        }
    }
}

struct Runs<'a> {
    runs: &'a [Run],
    seeds: Vec<u64>,
    nodes: usize,
}

impl Runs<'_> {
    /// Per seed, the mean loss of the selected runs, counted from the end.
    fn by_seed(
        &self,
        which: &dyn Fn(&Variant) -> bool,
        measure: Measure,
        from_end: usize,
    ) -> Vec<f64> {
        let of_seed = |seed: &u64| {
            let runs = self.runs.iter();
            let runs = runs.filter(|run| run.seed == *seed && which(&run.variant));
            let losses: Vec<f64> = runs
                .filter_map(|run| {
                    let point = run.points.iter().rev().nth(from_end)?;
                    Some(measure.of(&run.variant, &point.losses, self.nodes))
                })
                .collect();
            losses.iter().sum::<f64>() / losses.len() as f64
        };
        self.seeds.iter().map(of_seed).collect()
    }

    fn kind(&self, kind: VariantKind, measure: Measure) -> Vec<f64> {
        self.by_seed(&|variant| variant.kind() == kind, measure, 0)
    }

    fn difference(
        &self,
        on: String,
        against: String,
        federated: &[f64],
        other: &[f64],
    ) -> Result<Difference, SimulationError> {
        let pairs = federated.iter().zip(other);
        let by_seed: Vec<f64> = pairs.map(|(federated, other)| federated - other).collect();
        let difference = interval(&by_seed)?;
        Ok(Difference {
            on,
            federated_minus: against,
            shows: FederationVerdict::of(&difference),
            difference,
            by_seed,
        })
    }
}

impl FederationVerdict {
    fn of(difference: &Interval) -> Self {
        match (difference.low, difference.high) {
            (_, high) if high < 0.0 => Self::FederationIsBetter,
            (low, _) if low > 0.0 => Self::FederationIsWorse,
            _ => Self::NoDifferenceShown,
        }
    }

    /// Text for people.
    pub fn text(self) -> &'static str {
        match self {
            Self::FederationIsBetter => "the federation is better",
            Self::FederationIsWorse => "the federation is worse",
            Self::NoDifferenceShown => "no difference is shown",
        }
    }
}

fn interval(values: &[f64]) -> Result<Interval, SimulationError> {
    Interval::of(values).ok_or_else(|| {
        let what =
            "a comparison needs two seeds or more: one states nothing of how much results vary";
        SimulationError::Data(what.into())
    })
}

/// Sums up runs of all variants with the same seeds.
///
/// # Errors
/// There are fewer than two seeds.
pub fn summary(
    runs: &[Run],
    nodes: &[NodeData],
    unseen: &[NodeData],
) -> Result<ComparisonSummary, SimulationError> {
    let mut seeds: Vec<u64> = runs.iter().map(|run| run.seed).collect();
    seeds.sort_unstable();
    seeds.dedup();
    let all = Runs {
        runs,
        seeds,
        nodes: nodes.len(),
    };
    let mut measures = vec![
        (
            Measure::Own,
            "held-out episodes of the node itself".to_owned(),
        ),
        (
            Measure::Others,
            "held-out episodes of the other nodes".to_owned(),
        ),
    ];
    for (number, one) in unseen.iter().enumerate() {
        measures.push((Measure::Unseen(number), format!("unseen {}", one.name)));
    }
    let (mut losses, mut differences) = (Vec::new(), Vec::new());
    for (measure, on) in &measures {
        let federated = all.kind(VariantKind::Federated, *measure);
        for kind in VariantKind::ALL {
            let by_seed = all.kind(kind, *measure);
            if kind != VariantKind::Federated {
                let against = kind.name().to_owned();
                differences.push(all.difference(on.clone(), against, &federated, &by_seed)?);
            }
            losses.push(Loss {
                on: on.clone(),
                variant: kind.name(),
                loss: interval(&by_seed)?,
                by_seed,
            });
        }
    }
    // Where all nodes train, both measures are the same.
    differences.retain(|one| {
        !(one.on == measures[1].1 && one.federated_minus == VariantKind::Centralised.name())
    });
    let mut each_node = Vec::new();
    for (number, node) in nodes.iter().enumerate() {
        let alone = Variant::Alone(number);
        let of_node = |run: &Run| {
            run.points
                .last()
                .map_or(f64::NAN, |point| point.losses[number])
        };
        let by_seed = |variant: Variant| -> Vec<f64> {
            let of_seed = |seed: &u64| {
                let runs = runs.iter();
                let mut runs = runs.filter(|run| run.seed == *seed && run.variant == variant);
                runs.next().map_or(f64::NAN, of_node)
            };
            all.seeds.iter().map(of_seed).collect()
        };
        each_node.push(all.difference(
            format!("held-out episodes of {}", node.name),
            alone.name(nodes),
            &by_seed(Variant::Federated),
            &by_seed(alone),
        )?);
    }
    Ok(ComparisonSummary {
        losses,
        differences,
        each_node,
        progress: progress(&all)?,
    })
}

fn progress(all: &Runs) -> Result<Vec<LossProgress>, SimulationError> {
    let points = all.runs.first().map_or(&[][..], |run| &run.points[..]);
    let of_kind = |kind: VariantKind| {
        let count = points.len();
        let points = points.iter().enumerate().map(|(number, point)| {
            let of = |variant: &Variant| variant.kind() == kind;
            let by_seed = all.by_seed(&of, Measure::Own, count - 1 - number);
            Ok((point.round, interval(&by_seed)?))
        });
        Ok(LossProgress {
            variant: kind.name(),
            points: points.collect::<Result<_, SimulationError>>()?,
        })
    };
    VariantKind::ALL.into_iter().map(of_kind).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compare::run::CurvePoint;
    use crate::compare::variant::Hyperparameters;

    fn data(name: &str) -> NodeData {
        NodeData {
            name: name.into(),
            recordings: Vec::new(),
            held_out: Vec::new(),
            trained_on: Vec::new(),
            evaluated: Vec::new(),
            draws: Vec::new(),
        }
    }

    fn run(variant: Variant, seed: u64, losses: [f64; 3]) -> Run {
        let first = CurvePoint {
            round: 0,
            losses: vec![9.0; 3],
        };
        let last = CurvePoint {
            round: 4,
            losses: losses.to_vec(),
        };
        Run {
            variant,
            seed,
            values: Hyperparameters {
                learning_rate: 1.0,
                fedprox_mu: None,
                strategy: None,
            },
            steps: 1,
            points: vec![first, last],
        }
    }

    fn runs() -> Vec<Run> {
        let mut runs = Vec::new();
        for (seed, more) in [(7, 0.0), (8, 0.5)] {
            runs.push(run(Variant::Federated, seed, [1.0, 2.0 + more, 3.0]));
            runs.push(run(
                Variant::Centralised,
                seed,
                [0.5, 1.5 + more, 3.5 - more],
            ));
            runs.push(run(Variant::Alone(0), seed, [1.25, 6.0, 8.0]));
            runs.push(run(Variant::Alone(1), seed, [4.0, 1.5, 6.0]));
        }
        runs
    }

    fn made() -> ComparisonSummary {
        summary(&runs(), &[data("node-1"), data("node-2")], &[data("c")]).unwrap()
    }

    #[test]
    fn alone_is_the_mean_of_the_nodes() {
        let summary = made();
        let of = |on: &str, variant: &str| {
            let mut losses = summary.losses.iter();
            let found = losses.find(|loss| loss.on == on && loss.variant == variant);
            found.unwrap().by_seed.clone()
        };
        assert_eq!(
            of("held-out episodes of the node itself", "federated"),
            [1.5, 1.75]
        );
        assert_eq!(
            of("held-out episodes of the other nodes", "federated"),
            [1.5, 1.75]
        );
        assert_eq!(
            of("held-out episodes of the node itself", "alone"),
            [1.375, 1.375]
        );
        assert_eq!(
            of("held-out episodes of the other nodes", "alone"),
            [5.0, 5.0]
        );
        assert_eq!(of("unseen c", "alone"), [7.0, 7.0]);
        assert_eq!(of("unseen c", "centralised"), [3.5, 3.0]);
    }

    #[test]
    fn differences_are_between_runs_of_the_same_seed() {
        let summary = made();
        let of = |on: &str, against: &str| {
            let all = summary.differences.iter().chain(&summary.each_node);
            let mut all = all.filter(|one| one.on == on && one.federated_minus == against);
            all.next().unwrap().clone()
        };
        let own = of("held-out episodes of the node itself", "centralised");
        assert_eq!(own.by_seed, [0.5, 0.5]);
        // Only the losses vary between the seeds.
        assert_eq!((own.difference.low, own.difference.high), (0.5, 0.5));
        assert_eq!(own.shows, FederationVerdict::FederationIsWorse);
        let others = of("held-out episodes of the other nodes", "alone");
        assert_eq!(others.by_seed, [-3.5, -3.25]);
        assert_eq!(others.shows, FederationVerdict::FederationIsBetter);
        let unseen = of("unseen c", "centralised");
        assert_eq!(unseen.by_seed, [-0.5, 0.0]);
        assert_eq!(unseen.shows, FederationVerdict::NoDifferenceShown);
        let node = of("held-out episodes of node-2", "node-2 alone");
        assert_eq!(node.by_seed, [0.5, 1.0]);
    }

    #[test]
    fn progress_goes_from_the_first_point_to_the_last() {
        let summary = made();
        let federated = &summary.progress[0];
        let points: Vec<_> = federated
            .points
            .iter()
            .map(|(round, loss)| (*round, loss.mean))
            .collect();
        assert_eq!(points, [(0, 9.0), (4, 1.625)]);
    }

    #[test]
    fn one_seed_is_too_few() {
        let runs: Vec<_> = runs().into_iter().filter(|run| run.seed == 7).collect();
        let error = summary(&runs, &[data("node-1"), data("node-2")], &[]).unwrap_err();
        assert!(error.to_string().contains("two seeds or more"), "{error}");
    }
}
