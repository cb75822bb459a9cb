//! A step's samples, noise and times. Without saved state: step `k` and epoch `e`, a fresh shuffle of all samples, have their own random
//! streams.

use rand::SeedableRng;
use rand_chacha::ChaCha20Rng;
use zk0_lerobot::config::PolicyConfig;

use crate::measure::evaluate::FlowDraw;
use crate::policy::random::index;

/// Endless epochs over `0..samples`, each a fresh Fisher-Yates shuffle.
pub struct Order {
    seed: u64,
    samples: usize,
    epoch: Option<(u64, Vec<usize>)>,
}

impl Order {
    /// Over `samples` samples, at least one.
    pub fn new(seed: u64, samples: usize) -> Self {
        Self {
            seed,
            samples: samples.max(1),
            epoch: None,
        }
    }

    /// The `size` samples of step `step` (from 0).
    pub fn batch(&mut self, step: usize, size: usize) -> Vec<usize> {
        let first = step as u64 * size as u64;
        (first..first + size as u64).map(|at| self.at(at)).collect()
    }

    fn at(&mut self, position: u64) -> usize {
        let count = self.samples as u64;
        let (epoch, place) = (position / count, (position % count) as usize);
        match &self.epoch {
            Some((at_hand, order)) if *at_hand == epoch => order[place],
            _ => {
                let order = shuffle(self.samples, &mut stream(self.seed, 2 * epoch + 1));
                let found = order[place];
                self.epoch = Some((epoch, order));
                found
            }
        }
    }
}

/// Noise and times of the `count` samples of step `step` (from 0).
pub fn draws(config: &PolicyConfig, seed: u64, step: usize, count: usize) -> Vec<FlowDraw> {
    let mut rng = stream(seed, 2 * step as u64);
    (0..count)
        .map(|_| FlowDraw::random(config, &mut rng))
        .collect()
}

pub(super) fn shuffle(count: usize, rng: &mut ChaCha20Rng) -> Vec<usize> {
    let mut order: Vec<usize> = (0..count).collect();
    for i in (1..count).rev() {
        order.swap(i, index(rng, i + 1));
    }
    order
}

/// Even numbers for steps, odd for epochs.
fn stream(seed: u64, number: u64) -> ChaCha20Rng {
    let mut rng = ChaCha20Rng::seed_from_u64(seed);
    rng.set_stream(number);
    rng
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::profile::Profile;

    #[test]
    fn every_epoch_takes_every_sample_once_in_another_order() {
        let mut order = Order::new(5, 10);
        let all: Vec<usize> = (0..10).flat_map(|step| order.batch(step, 4)).collect();
        for epoch in all.chunks(10) {
            let mut sorted = epoch.to_vec();
            sorted.sort_unstable();
            assert_eq!(sorted, (0..10).collect::<Vec<_>>());
        }
        assert_ne!(all[..10], all[10..20]);
        assert_ne!(all[..10], (0..10).collect::<Vec<_>>());
    }

    #[test]
    fn a_step_is_the_same_whatever_came_before() {
        let mut through = Order::new(5, 7);
        let all: Vec<_> = (0..20).map(|step| through.batch(step, 3)).collect();
        for step in (0..20).rev() {
            assert_eq!(Order::new(5, 7).batch(step, 3), all[step]);
            assert_eq!(through.batch(step, 3), all[step]);
        }
        assert_ne!(Order::new(6, 7).batch(0, 3), all[0]);
    }

    #[test]
    fn draws_are_those_of_seed_and_step() {
        let config = Profile::Micro.config();
        let of = |seed, step| draws(&config, seed, step, 3);
        assert_eq!(of(1, 4), of(1, 4));
        assert_eq!(of(1, 4)[..2], draws(&config, 1, 4, 2));
        assert_ne!(of(1, 4), of(1, 5));
        assert_ne!(of(1, 4), of(2, 4));
        assert_ne!(of(1, 4)[0], of(1, 4)[1]);
    }
}
