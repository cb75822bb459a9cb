//! How a round's updates become the new global weights, as the rules name it. `zk0-verifier` computes it.

use crate::rules::basis_points::BPS;
use borsh::{BorshDeserialize, BorshSerialize};
use serde::{Deserialize, Serialize};

/// How a round's updates become the new global weights, with the same bits on every machine.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize, Serialize, Deserialize,
)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum Strategy {
    /// The mean, weighted by shares (McMahan et al. 2017, arXiv:1602.05629).
    FedAvg,
    /// The median of each parameter, with equal weights (Yin et al. 2018, arXiv:1803.01498).
    Median,
    /// The mean of each parameter without its extremes, with equal weights (ibid.).
    TrimmedMean {
        /// The share of contributors left out at either end, in basis points, rounded down; below 5,000.
        trim_bps: u32,
    },
    /// The contribution nearest to others (Blanchard et al. 2017, arXiv:1703.02757).
    Krum {
        /// The share of contributors that may be malicious, in basis points, rounded down; 1 to 4,999.
        byzantine_bps: u32,
    },
    /// The mean of Krum's best contributions, with equal weights (ibid.).
    MultiKrum {
        /// As for [`Strategy::Krum`].
        byzantine_bps: u32,
        /// The share of contributors kept, at least one, in basis points, rounded down; 1 to 10,000.
        keep_bps: u32,
    },
    /// The mean, weighted by shares, with long differences from the base scaled down.
    NormClipping {
        /// The longest difference, in basis points of the base's Euclidean norm; 1 to 1,000,000.
        max_norm_bps: u32,
    },
    /// The mean, weighted by shares, as a step of gradient descent with momentum (Hsu et al. 2019, arXiv:1909.06335).
    FedAvgM {
        /// How far the base moves to the mean, in basis points of the way; 1 to 100,000.
        server_rate_bps: u32,
        /// How much of the last movement is added, in basis points; below 10,000.
        momentum_bps: u32,
    },
    /// The mean, weighted by shares, as a step of Adam (Reddi et al. 2021, arXiv:2003.00295).
    FedAdam {
        /// The server's learning rate η, in billionths; 1 to 1,000,000,000.
        server_rate_billionths: u32,
        /// How much of the first moment is kept, β₁, in basis points; below 10,000.
        beta1_bps: u32,
        /// The same of the second moment, β₂.
        beta2_bps: u32,
        /// A constant beside the root of the second moment, τ, in billionths; 1 to 1,000,000,000. The larger, the less a step
        /// depends on the weight's earlier movement.
        tau_billionths: u32,
    },
    /// The mean, with equal weights, of updates that nodes must train by SCAFFOLD (Karimireddy et al. 2020, arXiv:1910.06378,
    /// option II).
    Scaffold(Scaffold),
}

/// How nodes train by SCAFFOLD: all alike, or the control variates would not follow from the ledger.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize, Serialize, Deserialize,
)]
#[serde(deny_unknown_fields)]
pub struct Scaffold {
    /// Steps of SGD by each node, K; 1 to 1,000,000.
    pub steps: u32,
    /// The learning rate of each step, η, in millionths; 1 to 100,000,000.
    pub learning_rate_millionths: u32,
    /// The control variates restart from 0 in each round that is a multiple of this; 1 to 1,000.
    pub restart_rounds: u32,
}

const MAX_LOCAL_STEPS: u32 = 1_000_000;

/// One, in the units of [`Scaffold::learning_rate_millionths`].
const MILLIONTHS: u32 = 1_000_000;

const MAX_LOCAL_RATE_MILLIONTHS: u32 = 100 * MILLIONTHS;

const MAX_RESTART_ROUNDS: u32 = 1_000;

impl Scaffold {
    /// The learning rate of each step, η.
    pub fn learning_rate(&self) -> f64 {
        f64::from(self.learning_rate_millionths) / f64::from(MILLIONTHS)
    }

    /// The last round, up to `round`, in which the control variates restarted.
    pub fn begins(&self, round: u64) -> u64 {
        round - round % u64::from(self.restart_rounds.max(1))
    }
}

const MAX_CLIPPING_BPS: u32 = 100 * BPS;

const MAX_SERVER_RATE_BPS: u32 = 10 * BPS;

/// One in the units of [`Strategy::FedAdam`]'s rate and τ, and their maximum.
pub const BILLIONTHS: u32 = 1_000_000_000;

impl Strategy {
    /// The bounds of its parameters.
    pub(crate) fn check(&self) -> Result<(), String> {
        let within =
            |name: &str, value: u32, least: u32, most: u32| match (least..=most).contains(&value) {
                true => Ok(()),
                false => Err(format!(
                    "rule strategy has {name} {value}; it has to be {least} to {most}"
                )),
            };
        let byzantine = |value| within("byzantine_bps", value, 1, BPS / 2 - 1);
        match *self {
            Self::FedAvg | Self::Median => Ok(()),
            Self::TrimmedMean { trim_bps } if trim_bps >= BPS / 2 => Err(format!(
                "rule strategy leaves out {trim_bps} basis points at either end, so nothing would be left; it has to be less than {}",
                BPS / 2
            )),
            Self::TrimmedMean { .. } => Ok(()),
            Self::Krum { byzantine_bps } => byzantine(byzantine_bps),
            Self::MultiKrum {
                byzantine_bps,
                keep_bps,
            } => {
                byzantine(byzantine_bps)?;
                within("keep_bps", keep_bps, 1, BPS)
            }
            Self::NormClipping { max_norm_bps } => {
                within("max_norm_bps", max_norm_bps, 1, MAX_CLIPPING_BPS)
            }
            Self::FedAvgM {
                server_rate_bps,
                momentum_bps,
            } => {
                within("server_rate_bps", server_rate_bps, 1, MAX_SERVER_RATE_BPS)?;
                within("momentum_bps", momentum_bps, 0, BPS - 1)
            }
            Self::FedAdam {
                server_rate_billionths,
                beta1_bps,
                beta2_bps,
                tau_billionths,
            } => {
                let rate = server_rate_billionths;
                within("server_rate_billionths", rate, 1, BILLIONTHS)?;
                within("beta1_bps", beta1_bps, 0, BPS - 1)?;
                within("beta2_bps", beta2_bps, 0, BPS - 1)?;
                within("tau_billionths", tau_billionths, 1, BILLIONTHS)
            }
            Self::Scaffold(Scaffold {
                steps,
                learning_rate_millionths: rate,
                restart_rounds,
            }) => {
                within("steps", steps, 1, MAX_LOCAL_STEPS)?;
                let name = "learning_rate_millionths";
                within(name, rate, 1, MAX_LOCAL_RATE_MILLIONTHS)?;
                within("restart_rounds", restart_rounds, 1, MAX_RESTART_ROUNDS)
            }
        }
    }
}
