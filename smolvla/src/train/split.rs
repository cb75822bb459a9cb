//! Divides episodes for training and evaluation. Neighbouring frames are nearly the same: a division by frames would show nothing about new
//! episodes.

use std::ops::Range;

use rand::SeedableRng;
use rand_chacha::ChaCha20Rng;
use serde::{Deserialize, Serialize};

use crate::error::{PolicyError, Result};
use crate::train::order::shuffle;

/// Numbers of episodes, in order.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Split {
    /// For training.
    pub train: Vec<usize>,
    /// For evaluation.
    pub eval: Vec<usize>,
}

impl Split {
    /// Holds out `share` of `episodes` episodes, chosen by `seed`: rounded, at least one if `share` is above 0, never all.
    ///
    /// # Errors
    /// [`PolicyError::Options`] if `share` is not in [0, 1), or a single episode would be divided.
    pub fn of(episodes: usize, share: f64, seed: u64) -> Result<Self> {
        if !(0.0..1.0).contains(&share) {
            return Err(PolicyError::Options(format!(
                "{share} of the episodes held out; it must be 0 or above and less than 1"
            )));
        }
        if share == 0.0 || episodes == 0 {
            return Ok(Self {
                train: (0..episodes).collect(),
                eval: Vec::new(),
            });
        }
        if episodes == 1 {
            return Err(PolicyError::Options(
                "a recording of one episode cannot be split; hold out nothing".into(),
            ));
        }
        let count = ((episodes as f64 * share).round() as usize).clamp(1, episodes - 1);
        let mut order = shuffle(episodes, &mut ChaCha20Rng::seed_from_u64(seed));
        let mut train = order.split_off(count);
        order.sort_unstable();
        train.sort_unstable();
        Ok(Self { train, eval: order })
    }
}

/// The frames of some episodes, in order.
pub fn frames(all: &[Range<usize>], episodes: &[usize]) -> Vec<usize> {
    let ranges = episodes.iter().filter_map(|episode| all.get(*episode));
    ranges.cloned().flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_episode_is_on_both_sides_and_none_is_lost() {
        for (episodes, share, held_out) in [(10, 0.2, 2), (6, 0.1, 1), (6, 0.99, 5), (2, 0.5, 1)] {
            let split = Split::of(episodes, share, 3).unwrap();
            assert_eq!(split.eval.len(), held_out);
            let mut all = [split.train.clone(), split.eval.clone()].concat();
            all.sort_unstable();
            assert_eq!(all, (0..episodes).collect::<Vec<_>>());
        }
        let split = Split::of(7, 0.0, 3).unwrap();
        assert_eq!((split.train.len(), split.eval.len()), (7, 0));
    }

    #[test]
    fn the_seed_decides() {
        let of = |seed| Split::of(100, 0.3, seed).unwrap();
        assert_eq!(of(1), of(1));
        assert_ne!(of(1), of(2));
    }

    #[test]
    fn splits_that_make_no_sense_are_refused() {
        for share in [1.0, -0.1, f64::NAN] {
            assert!(Split::of(5, share, 0).is_err());
        }
        assert!(Split::of(1, 0.5, 0).is_err());
    }

    #[test]
    fn frames_are_those_of_whole_episodes() {
        let all = [0..3, 3..5, 5..9];
        assert_eq!(frames(&all, &[0, 2]), [0, 1, 2, 5, 6, 7, 8]);
    }
}
