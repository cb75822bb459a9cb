//! Chooses learning rates, FedProx's μ and strategies by trials, with the tree-structured Parzen estimator (Bergstra et al. 2011) of the
//! crate `tpe`. The next trial depends only on the seed and earlier trials: a stopped search can go on.

use crate::compare::variant::{Hyperparameters, VariantKind};
use rand_0_10::rngs::StdRng;
use rand_0_10::SeedableRng;
use serde::{Deserialize, Serialize};
use tpe::density_estimation::DefaultEstimatorBuilder;
use tpe::range::Range;
use tpe::{TpeOptimizer, TpeOptimizerBuilder};
use zk0_protocol::rules::network_rules::Strategy;

/// A kind's random trials after the first.
pub const AT_RANDOM: usize = 4;

const GOOD: f64 = 0.25;

/// What a search tries. Each kind's first trial has the user's values.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Space {
    /// The user's values.
    pub given: Hyperparameters,
    /// Learning rates differ from the given one by at most this factor.
    pub factor: f64,
    /// Choices for FedProx's μ.
    pub mus: Vec<f64>,
    /// Choices for the strategy.
    pub strategies: Vec<Strategy>,
}

/// A trial and its result.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Trial {
    /// The kind of variant.
    pub kind: VariantKind,
    /// The values.
    pub values: Hyperparameters,
    /// The loss on the validation episodes; `None` if training failed.
    pub loss: Option<f64>,
    /// Why training failed.
    pub failed: Option<String>,
}

impl Trial {
    /// A failed trial is worst.
    fn score(&self) -> f64 {
        let finite = self.loss.filter(|loss| loss.is_finite());
        finite.unwrap_or(f64::INFINITY)
    }
}

struct SearchedValue {
    of: fn(&Hyperparameters, &Space) -> Option<f64>,
    range: Option<Range>,
    estimator: fn() -> DefaultEstimatorBuilder,
}

impl Space {
    /// A kind's next values, after its trials.
    pub fn next(&self, kind: VariantKind, seed: u64, trials: &[Trial]) -> Hyperparameters {
        if trials.is_empty() {
            return self.given(kind);
        }
        let mut bytes = [0; 32];
        bytes[..8].copy_from_slice(&seed.to_le_bytes());
        bytes[8..16].copy_from_slice(&(trials.len() as u64).to_le_bytes());
        bytes[16] = kind as u8;
        let mut rng = StdRng::from_seed(bytes);
        let known: &[Trial] = if trials.len() <= AT_RANDOM {
            &[]
        } else {
            trials
        };
        let mut ask = |searched: SearchedValue| self.ask(&searched, known, &mut rng);
        let mut values = self.given(kind);
        let rate = ask(SearchedValue {
            of: |values, _| Some(values.learning_rate.ln()),
            range: self.rates(),
            estimator: tpe::parzen_estimator,
        });
        if let Some(rate) = rate {
            // The printed digits give the same result.
            let digits = format!("{:.3e}", rate.exp());
            values.learning_rate = digits.parse().unwrap_or(values.learning_rate);
        }
        if kind == VariantKind::Federated {
            let mu = ask(SearchedValue {
                of: |values, space| place(&space.mus, &values.fedprox_mu?),
                range: tpe::categorical_range(self.mus.len()).ok(),
                estimator: tpe::histogram_estimator,
            });
            let strategy = ask(SearchedValue {
                of: |values, space| place(&space.strategies, &values.strategy?),
                range: tpe::categorical_range(self.strategies.len()).ok(),
                estimator: tpe::histogram_estimator,
            });
            let chosen = |place: Option<f64>| place.map_or(0, |place| place as usize);
            values.fedprox_mu = self.mus.get(chosen(mu)).copied();
            values.strategy = self.strategies.get(chosen(strategy)).copied();
        }
        values
    }

    /// The user's values for a kind.
    pub fn given(&self, kind: VariantKind) -> Hyperparameters {
        match kind {
            VariantKind::Federated => self.given.clone(),
            VariantKind::Centralised | VariantKind::Alone => Hyperparameters {
                fedprox_mu: None,
                strategy: None,
                ..self.given
            },
        }
    }

    /// Logarithms; `None` for only one.
    fn rates(&self) -> Option<Range> {
        let (given, factor) = (self.given.learning_rate.ln(), self.factor.ln());
        tpe::range(given - factor, given + factor).ok()
    }

    fn ask(&self, searched: &SearchedValue, known: &[Trial], rng: &mut StdRng) -> Option<f64> {
        let mut builder = TpeOptimizerBuilder::new();
        let builder = builder.gamma(GOOD);
        let mut optimizer: TpeOptimizer = builder
            .build((searched.estimator)(), searched.range?)
            .ok()?;
        for trial in known {
            let value = (searched.of)(&trial.values, self);
            // A value outside the range gives no information.
            let _ = optimizer.tell(value.unwrap_or(f64::NAN), trial.score());
        }
        optimizer.ask(rng).ok()
    }
}

fn place<T: PartialEq>(all: &[T], one: &T) -> Option<f64> {
    let place = all.iter().position(|other| other == one)?;
    Some(place as f64)
}

/// The first trial with the least loss; `None` if all failed.
pub fn best(trials: &[Trial]) -> Option<&Trial> {
    let ended = trials.iter().filter(|trial| trial.score().is_finite());
    ended.min_by(|one, other| one.score().total_cmp(&other.score()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn space() -> Space {
        Space {
            given: Hyperparameters {
                learning_rate: 1e-3,
                fedprox_mu: Some(0.0),
                strategy: Some(Strategy::FedAvg),
            },
            factor: 10.0,
            mus: vec![0.0, 0.01, 1.0],
            strategies: vec![
                Strategy::FedAvg,
                Strategy::Median,
                Strategy::TrimmedMean { trim_bps: 1000 },
            ],
        }
    }

    fn loss(values: &Hyperparameters) -> f64 {
        let rate = (values.learning_rate / 3e-3).ln().powi(2);
        let mu = f64::from(u8::from(values.fedprox_mu != Some(0.01)));
        let strategy = f64::from(u8::from(values.strategy != Some(Strategy::Median)));
        rate + mu + strategy
    }

    fn trials(
        kind: VariantKind,
        seed: u64,
        count: usize,
        outcome: fn(&Hyperparameters) -> Option<f64>,
    ) -> Vec<Trial> {
        let mut trials = Vec::new();
        for _ in 0..count {
            let values = space().next(kind, seed, &trials);
            let loss = outcome(&values);
            trials.push(Trial {
                kind,
                values,
                loss,
                failed: loss.is_none().then(|| "it diverged".into()),
            });
        }
        trials
    }

    #[test]
    fn a_search_finds_what_is_good() {
        for seed in 0..5 {
            let trials = trials(VariantKind::Federated, seed, 60, |values| {
                Some(loss(values))
            });
            assert_eq!(trials[0].values, space().given);
            for trial in &trials {
                assert!((0.99e-4..=1.01e-2).contains(&trial.values.learning_rate));
            }
            let best = best(&trials).unwrap();
            assert!(loss(&best.values) < 0.05, "seed {seed}: {best:?}");
            let mean = |some: &[Trial]| some.iter().map(Trial::score).sum::<f64>() / 20.0;
            assert!(
                mean(&trials[40..]) < 0.5 * mean(&trials[..20]),
                "seed {seed}"
            );
        }
    }

    #[test]
    fn the_seed_and_the_trials_decide_what_is_tried() {
        let of = |seed| {
            trials(VariantKind::Federated, seed, 12, |values| {
                Some(loss(values))
            })
        };
        assert_eq!(of(3), of(3));
        assert_ne!(of(3), of(4));
        let all = of(3);
        assert_eq!(
            space().next(VariantKind::Federated, 3, &all[..9]),
            all[9].values
        );
    }

    #[test]
    fn what_failed_is_worse_than_all_else() {
        let diverges =
            |values: &Hyperparameters| (values.learning_rate < 1e-3).then(|| -values.learning_rate);
        let trials = trials(VariantKind::Alone, 0, 40, diverges);
        assert!(trials.iter().any(|trial| trial.loss.is_none()));
        let best = best(&trials).unwrap();
        assert!(
            (6e-4..1e-3).contains(&best.values.learning_rate),
            "{best:?}"
        );
        let failed: Vec<Trial> = trials
            .into_iter()
            .filter(|trial| trial.loss.is_none())
            .collect();
        assert_eq!(super::best(&failed), None);
    }

    #[test]
    fn without_a_federation_there_is_only_a_rate() {
        for kind in [VariantKind::Centralised, VariantKind::Alone] {
            for trial in trials(kind, 0, 8, |_| Some(1.0)) {
                assert_eq!(
                    (trial.values.fedprox_mu, trial.values.strategy),
                    (None, None)
                );
            }
        }
    }
}
