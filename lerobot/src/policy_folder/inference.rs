//! What a policy needs to act besides weights and tokenizer: normalisation and the number of Euler steps.

use serde::{Deserialize, Serialize};

use crate::config::PolicyConfig;
use crate::dataset::{Normalizer, Stats};
use crate::error::{Result, StoredPolicyError};

/// LeRobot's normalisations that are implemented.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
pub enum Normalisation {
    /// To mean 0 and standard deviation 1.
    #[default]
    MeanStd,
    /// Not at all.
    Identity,
}

/// Default Euler steps, LeRobot's `num_steps`.
pub const STEPS: usize = 10;
/// Most Euler steps allowed.
const STEPS_LIMIT: usize = 1000;

/// How a policy is used.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Inference {
    /// Euler steps from noise to actions.
    pub num_steps: usize,
    /// How states are normalised.
    pub state: Normalisation,
    /// How actions are.
    pub action: Normalisation,
    /// Statistics of its training; `None` where it has none: a recording's then count.
    pub stats: Option<Stats>,
}

impl Default for Inference {
    /// LeRobot's, before any recording.
    fn default() -> Self {
        Self {
            num_steps: STEPS,
            state: Normalisation::default(),
            action: Normalisation::default(),
            stats: None,
        }
    }
}

impl Inference {
    /// What normalises samples of recordings with these statistics in the policy's training.
    pub fn fitted(&self, recording: &Stats) -> Stats {
        Stats {
            state: self.state.of(&recording.state),
            action: self.action.of(&recording.action),
        }
    }

    /// Refuses what a policy of these dimensions cannot use.
    ///
    /// # Errors
    /// [`StoredPolicyError::Config`].
    pub fn check(&self, config: &PolicyConfig) -> Result<()> {
        if !(1..=STEPS_LIMIT).contains(&self.num_steps) {
            return Err(StoredPolicyError::Config(format!(
                "`num_steps` is {}; it must be in 1..={STEPS_LIMIT}",
                self.num_steps
            )));
        }
        let dims = |stats: &Stats| (stats.state.dim(), stats.action.dim());
        match self.stats.as_ref().map(dims) {
            Some(dims) if dims != (config.state_dim, config.action_dim) => {
                Err(StoredPolicyError::Config(format!(
                    "the statistics are of {} state and {} action dimensions, the policy has {} and {}",
                    dims.0, dims.1, config.state_dim, config.action_dim
                )))
            }
            _ => Ok(()),
        }
    }
}

impl Normalisation {
    /// By LeRobot's name, for `feature`.
    ///
    /// # Errors
    /// [`StoredPolicyError::Config`] if it is not implemented.
    pub fn named(mode: &str, feature: &str) -> Result<Self> {
        match mode {
            "MEAN_STD" => Ok(Self::MeanStd),
            "IDENTITY" => Ok(Self::Identity),
            other => Err(StoredPolicyError::Config(format!(
                "`{feature}` is normalised by `{other}`; only `MEAN_STD` and `IDENTITY` are implemented"
            ))),
        }
    }

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::MeanStd => "MEAN_STD",
            Self::Identity => "IDENTITY",
        }
    }

    fn of(self, recording: &Normalizer) -> Normalizer {
        match self {
            Self::MeanStd => recording.clone(),
            // A recording's normaliser has at least one dimension.
            Self::Identity => {
                Normalizer::identity(recording.dim()).unwrap_or_else(|| recording.clone())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy_folder::lerobot_config::LeRobotConfig;

    fn config() -> PolicyConfig {
        let folder = concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../tests/fixtures/smolvla_tiny"
        );
        let text = |file: &str| std::fs::read_to_string(format!("{folder}/{file}")).unwrap();
        let (policy, vlm) = (text("policy_config.json"), text("vlm_config.json"));
        LeRobotConfig::parse(&policy, Some(&vlm)).unwrap().dims
    }

    fn stats(dim: usize) -> Stats {
        // Numbers without a short decimal form.
        let mean = (0..dim).map(|d| 1.0 / (3.0 + d as f32)).collect();
        let std = (0..dim).map(|d| f32::MIN_POSITIVE * d as f32).collect();
        Stats {
            state: Normalizer::new(mean, std).unwrap(),
            action: Normalizer::new(vec![f32::MAX; dim], vec![0.1; dim]).unwrap(),
        }
    }

    #[test]
    fn what_is_written_is_read_to_the_last_bit() {
        let inference = Inference {
            num_steps: 4,
            state: Normalisation::Identity,
            action: Normalisation::MeanStd,
            stats: Some(stats(6)),
        };
        let text = serde_json::to_string(&inference).unwrap();
        assert!(text.contains(r#""state":"IDENTITY","action":"MEAN_STD""#));
        let back: Inference = serde_json::from_str(&text).unwrap();
        assert_eq!(back, inference);
        back.check(&config()).unwrap();
        for wrong in [
            text.replacen("\"mean\":[", "\"mean\":[1.0,", 1),
            text.replace("\"std\":[", "\"std\":[-"),
            text.replacen("\"mean\":[", "\"mean\":[1e39,", 1).replacen(
                "\"std\":[",
                "\"std\":[1.0,",
                1,
            ),
            text.replace("MEAN_STD", "MIN_MAX"),
        ] {
            assert!(
                serde_json::from_str::<Inference>(&wrong).is_err(),
                "{wrong}"
            );
        }
    }

    #[test]
    fn what_cannot_be_the_policy_s_is_refused() {
        let policy = config();
        let refused = |inference: Inference| inference.check(&policy).unwrap_err().to_string();
        for num_steps in [0, 1001] {
            let inference = Inference {
                num_steps,
                ..Inference::default()
            };
            assert!(refused(inference).contains("`num_steps`"));
        }
        let inference = Inference {
            stats: Some(stats(5)),
            ..Inference::default()
        };
        assert!(refused(inference).contains("5 state and 5 action"));
    }

    #[test]
    fn a_feature_that_is_not_normalised_stays_as_it_is() {
        let inference = Inference {
            action: Normalisation::Identity,
            ..Inference::default()
        };
        let fitted = inference.fitted(&stats(6));
        assert_eq!(fitted.state, stats(6).state);
        let mut values = [0.1, -2.0, 3e30, 0.0, 5.5, 1e-30];
        fitted.action.normalize(&mut values);
        assert_eq!(values, [0.1, -2.0, 3e30, 0.0, 5.5, 1e-30]);
    }
}
