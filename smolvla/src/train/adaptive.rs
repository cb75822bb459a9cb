//! How a node's proximal weight and learning rate follow losses: the Python zk0's rules (<https://github.com/ivelin/zk0>,
//! `src/training/scheduler_utils.py`).
//!
//! - **Dynamic mu.** When the global loss stalls, mu and the learning rate shrink by a fifth; when it grows, they grow by a tenth
//!   ([`Trend`], [`follow`]).
//! - **Learning-rate boost.** A client with a loss far above its average trains at a higher rate ([`boost`]).
//!
//! [`adapted`] does both.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::error::{PolicyError, Result};

const WINDOW: usize = 3;
/// More growth diverges.
const DIVERGING: f64 = -0.05;
/// Less reduction stalls.
const STALLED: f64 = 0.01;

/// The course of the global model's loss.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Trend {
    /// Fewer than three rounds were evaluated.
    Unknown,
    /// It falls by at least 1 % over three rounds.
    Improving,
    /// It does neither.
    Stalled,
    /// It grows by more than 5 % over three rounds.
    Diverging,
}

impl Trend {
    /// From the global model's losses, oldest first; the last three count.
    ///
    /// # Errors
    /// [`PolicyError::Options`] if a loss is negative or not a number.
    pub fn of(losses: &[f64]) -> Result<Self> {
        check("a round's loss", losses)?;
        let [first, .., last] = losses[losses.len().saturating_sub(WINDOW)..] else {
            return Ok(Self::Unknown);
        };
        if losses.len() < WINDOW {
            return Ok(Self::Unknown);
        }
        let improvement = (first - last) / first.max(1e-8);
        Ok(if improvement < DIVERGING {
            Self::Diverging
        } else if improvement < STALLED {
            Self::Stalled
        } else {
            Self::Improving
        })
    }

    /// The factor of mu and the learning rate.
    pub fn factor(self) -> f64 {
        match self {
            Self::Stalled => 0.8,
            Self::Diverging => 1.1,
            Self::Unknown | Self::Improving => 1.0,
        }
    }
}

/// A round's proximal weight and peak learning rate.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Rates {
    /// Weight of FedProx's term.
    pub mu: f64,
    /// Peak learning rate.
    pub learning_rate: f64,
}

/// Bounds of a trend's learning rate: (least, most).
pub const LEARNING_RATES: (f64, f64) = (1e-5, 1e-3);

/// The next rates. A learning rate beyond [`LEARNING_RATES`] stays.
pub fn follow(rates: Rates, trend: Trend) -> Rates {
    let (least, most) = LEARNING_RATES;
    let (factor, now) = (trend.factor(), rates.learning_rate);
    let learning_rate = match trend {
        Trend::Stalled => (now * factor).max(least.min(now)),
        Trend::Diverging => (now * factor).min(most.max(now)),
        Trend::Unknown | Trend::Improving => now,
    };
    Rates {
        mu: rates.mu * factor,
        learning_rate,
    }
}

/// When and how much a client's learning rate rises.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Boost {
    /// A loss above this multiple of the average is high.
    pub threshold: f64,
    /// The learning rate's factor then.
    pub factor: f64,
}

impl Default for Boost {
    /// The Python zk0's `high_loss_multiplier` and `lr_boost_factor`.
    fn default() -> Self {
        Self {
            threshold: 2.0,
            factor: 1.15,
        }
    }
}

impl Boost {
    /// Checks that the factor is in [1, 10] and the threshold at least 1.
    ///
    /// # Errors
    /// [`PolicyError::Options`].
    pub fn check(&self) -> Result<()> {
        if !(1.0..=10.0).contains(&self.factor) {
            return Err(PolicyError::Options(format!(
                "a learning-rate boost of {}; it must be in 1..=10",
                self.factor
            )));
        }
        if !(self.threshold >= 1.0 && self.threshold.is_finite()) {
            return Err(PolicyError::Options(format!(
                "a boost above {} times the average loss; that must be 1 or more",
                self.threshold
            )));
        }
        Ok(())
    }
}

/// A client's learning-rate factor: `boost.factor` if its loss exceeds `boost.threshold` times its average, else 1.
///
/// # Errors
/// [`PolicyError::Options`] if a loss is negative or not a number, or as [`Boost::check`].
pub fn boost(boost: Boost, average: f64, current: f64) -> Result<f64> {
    check("a client's loss", &[average, current])?;
    boost.check()?;
    Ok(if current > average * boost.threshold {
        boost.factor
    } else {
        1.0
    })
}

/// Which rules a node follows.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Adaptation {
    /// Mu and the learning rate follow the trend.
    pub follow: bool,
    /// A round's high first loss raises its learning rate.
    pub boost: Option<Boost>,
}

impl Adaptation {
    /// Whether a loss has to be measured.
    pub fn is_wanted(&self) -> bool {
        self.follow || self.boost.is_some()
    }
}

/// A round's rates and their reasons.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Adapted {
    /// The round's rates.
    pub rates: Rates,
    /// The loss at its start.
    pub loss: f64,
    /// The losses' course, if the rates follow it.
    pub trend: Option<Trend>,
    /// The mean of earlier losses, if any.
    pub average: Option<f64>,
    /// The learning rate's factor, if boosts are allowed.
    pub boosted: Option<f64>,
}

/// A node's rates for the next round, from `start`. `losses` are those of the rounds' base weights on its samples, oldest first, the next
/// round's last. With [`Adaptation::follow`], every round so far changes the rates by [`follow`]; a boost is for one round.
///
/// # Errors
/// [`PolicyError::Options`] if there is no loss, or one is negative or not a number, or as [`Boost::check`].
pub fn adapted(start: Rates, adaptation: Adaptation, losses: &[f64]) -> Result<Adapted> {
    let Some((loss, before)) = losses.split_last() else {
        return Err(PolicyError::Options("no loss to follow".into()));
    };
    let (mut rates, mut trend) = (start, None);
    if adaptation.follow {
        for round in 1..=losses.len() {
            let seen = Trend::of(&losses[round.saturating_sub(WINDOW)..round])?;
            rates = follow(rates, seen);
            trend = Some(seen);
        }
    }
    let average = match before.len() {
        0 => None,
        rounds => Some(before.iter().sum::<f64>() / rounds as f64),
    };
    let mut boosted = None;
    if let Some(rule) = adaptation.boost {
        rule.check()?;
        check("a round's loss", losses)?;
        let factor = match average {
            Some(average) => boost(rule, average, *loss)?,
            None => 1.0,
        };
        rates.learning_rate *= factor;
        boosted = Some(factor);
    }
    Ok(Adapted {
        rates,
        loss: *loss,
        trend,
        average,
        boosted,
    })
}

impl fmt::Display for Adapted {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "loss of the base weights {:.4}", self.loss)?;
        match self.trend {
            Some(Trend::Unknown) => write!(f, ", too early for a trend")?,
            Some(Trend::Improving) => write!(f, ", improving")?,
            Some(Trend::Stalled) => write!(f, ", stalled")?,
            Some(Trend::Diverging) => write!(f, ", diverging")?,
            None => {}
        }
        if let Some(factor) = self.boosted {
            match self.average {
                Some(average) => write!(f, ", {average:.4} on average before")?,
                None => write!(f, ", the first")?,
            }
            if factor != 1.0 {
                write!(f, ", so the learning rate times {factor}")?;
            }
        }
        let Rates { mu, learning_rate } = self.rates;
        write!(f, ": mu {mu:.3e}, learning rate {learning_rate:.3e}")
    }
}

fn check(what: &str, losses: &[f64]) -> Result<()> {
    let wrong = losses
        .iter()
        .find(|loss| !(loss.is_finite() && **loss >= 0.0));
    match wrong {
        Some(loss) => Err(PolicyError::Options(format!("{what} is {loss}"))),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn trends_are_those_of_the_last_three_rounds() {
        let of = |losses: &[f64]| Trend::of(losses).unwrap();
        assert_eq!(of(&[]), Trend::Unknown);
        assert_eq!(of(&[1.0]), Trend::Unknown);
        assert_eq!(of(&[1.0, 0.5]), Trend::Unknown);
        assert_eq!(of(&[1.0, 2.0, 0.98]), Trend::Improving);
        assert_eq!(of(&[1.0, 0.5, 0.995]), Trend::Stalled);
        assert_eq!(of(&[1.0, 0.5, 1.04]), Trend::Stalled);
        assert_eq!(of(&[1.0, 0.5, 1.06]), Trend::Diverging);
        assert_eq!(of(&[9.0, 1.0, 1.0, 0.9]), Trend::Improving);
        assert_eq!(of(&[0.0, 0.0, 0.0]), Trend::Stalled);
        assert!(Trend::of(&[1.0, f64::NAN]).is_err());
        assert!(Trend::of(&[-1.0]).is_err());
    }

    #[test]
    fn mu_and_learning_rate_move_together_within_bounds() {
        let rates = |mu, learning_rate| Rates { mu, learning_rate };
        let near = |a: Rates, b: Rates| {
            assert!((a.mu - b.mu).abs() < 1e-15, "{a:?} {b:?}");
            assert!(
                (a.learning_rate - b.learning_rate).abs() < 1e-15,
                "{a:?} {b:?}"
            );
        };
        let start = rates(0.01, 5e-4);
        near(follow(start, Trend::Stalled), rates(0.008, 4e-4));
        near(follow(start, Trend::Diverging), rates(0.011, 5.5e-4));
        near(follow(start, Trend::Improving), start);
        near(follow(start, Trend::Unknown), start);
        near(follow(rates(1.0, 1.1e-5), Trend::Stalled), rates(0.8, 1e-5));
        near(
            follow(rates(1.0, 9.9e-4), Trend::Diverging),
            rates(1.1, 1e-3),
        );
        near(follow(rates(1.0, 2e-3), Trend::Diverging), rates(1.1, 2e-3));
        near(follow(rates(1.0, 1e-6), Trend::Stalled), rates(0.8, 1e-6));
    }

    #[test]
    fn hard_clients_learn_faster() {
        let rule = Boost::default();
        assert_eq!(boost(rule, 0.5, 1.0).unwrap(), 1.0);
        assert_eq!(boost(rule, 0.5, 1.01).unwrap(), 1.15);
        assert_eq!(boost(rule, 0.5, 0.1).unwrap(), 1.0);
        assert!(boost(rule, f64::INFINITY, 1.0).is_err());
        let factor = |factor| Boost { factor, ..rule };
        assert!(boost(factor(0.9), 1.0, 1.0).is_err());
        assert!(boost(factor(f64::NAN), 1.0, 1.0).is_err());
        let threshold = |threshold| Boost { threshold, ..rule };
        assert!(boost(threshold(0.5), 1.0, 1.0).is_err());
    }

    const START: Rates = Rates {
        mu: 0.01,
        learning_rate: 5e-4,
    };

    fn following() -> Adaptation {
        Adaptation {
            follow: true,
            boost: None,
        }
    }

    #[test]
    fn rates_are_carried_on_from_round_to_round() {
        let rates = |losses: &[f64]| adapted(START, following(), losses).unwrap().rates;
        assert_eq!(rates(&[1.0]), START);
        assert_eq!(rates(&[1.0, 1.0]), START);
        let once = Rates {
            mu: 0.01 * 0.8,
            learning_rate: 5e-4 * 0.8,
        };
        assert_eq!(rates(&[1.0, 1.0, 1.0]), once);
        let twice = Rates {
            mu: once.mu * 0.8,
            learning_rate: once.learning_rate * 0.8,
        };
        assert_eq!(rates(&[1.0, 1.0, 1.0, 1.0]), twice);
        assert_eq!(rates(&[1.0, 1.0, 1.0, 0.5, 0.4]), once);
        let grown = follow(once, Trend::Diverging);
        assert_eq!(rates(&[1.0, 1.0, 1.0, 2.0]), grown);
        assert!(grown.mu > once.mu && grown.learning_rate > once.learning_rate);
    }

    #[test]
    fn a_boost_is_for_one_round_and_compares_with_the_rounds_before() {
        let boost = Some(Boost {
            factor: 1.5,
            ..Boost::default()
        });
        let of =
            |follow, losses: &[f64]| adapted(START, Adaptation { follow, boost }, losses).unwrap();
        let rate = |losses: &[f64]| of(false, losses).rates.learning_rate;
        assert_eq!(rate(&[9.0]), 5e-4, "nothing to compare with");
        assert_eq!(rate(&[1.0, 2.0]), 5e-4);
        assert_eq!(rate(&[1.0, 2.1]), 5e-4 * 1.5);
        assert_eq!(rate(&[1.0, 3.0, 4.0]), 5e-4, "2 on average");
        assert_eq!(rate(&[1.0, 2.1, 1.0]), 5e-4, "it is over");
        assert_eq!(of(false, &[1.0, 2.1]).rates.mu, START.mu);
        let both = of(true, &[1.0, 1.0, 2.1]);
        assert_eq!(both.rates.learning_rate, 5e-4 * 1.1 * 1.5);
        assert_eq!(both.rates.mu, 0.01 * 1.1);
        assert_eq!(
            both.to_string(),
            "loss of the base weights 2.1000, diverging, 1.0000 on average before, so the learning rate times 1.5: \
             mu 1.100e-2, learning rate 8.250e-4"
        );
    }

    #[test]
    fn nothing_follows_unless_it_is_wanted() {
        assert!(!Adaptation::default().is_wanted());
        assert!(following().is_wanted());
        let none = adapted(START, Adaptation::default(), &[1.0, 1.0, 1.0, 9.0]).unwrap();
        assert_eq!(none.rates, START);
    }

    #[test]
    fn losses_and_boosts_that_make_no_sense_are_refused() {
        assert!(adapted(START, following(), &[]).is_err());
        assert!(adapted(START, following(), &[1.0, f64::NAN]).is_err());
        let boost = |factor| Adaptation {
            follow: false,
            boost: Some(Boost {
                factor,
                ..Boost::default()
            }),
        };
        assert!(adapted(START, boost(0.5), &[1.0]).is_err());
        assert!(adapted(START, boost(1.5), &[-1.0]).is_err());
        assert!(adapted(START, boost(1.5), &[1.0]).is_ok());
    }
}
