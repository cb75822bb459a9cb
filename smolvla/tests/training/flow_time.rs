//! Flow times have LeRobot's distribution, 0.999 Beta(1.5, 1) + 0.001.

use rand::{RngCore, SeedableRng};
use rand_chacha::ChaCha20Rng;
use zk0_smolvla::policy::profile::Profile;
use zk0_smolvla::policy::random::{flow_time, uniform};
use zk0_smolvla::train::order;

/// Returns the share of LeRobot's draws up to a time. Beta(1.5, 1) has the distribution function x^1.5, which is shifted and scaled
/// here.
fn share_up_to(time: f64) -> f64 {
    ((time - 0.001) / 0.999).clamp(0.0, 1.0).powf(1.5)
}

/// Kolmogorov and Smirnov's distance of times from LeRobot's distribution.
fn distance(mut times: Vec<f64>) -> f64 {
    times.sort_by(f64::total_cmp);
    let count = times.len() as f64;
    let gaps = times.iter().enumerate().map(|(i, time)| {
        let share = share_up_to(*time);
        (share - i as f64 / count).max((i + 1) as f64 / count - share)
    });
    gaps.fold(0.0, f64::max)
}

fn moments_and_distance_are_lerobots(times: Vec<f64>) {
    let count = times.len() as f64;
    let mean = times.iter().sum::<f64>() / count;
    let variance = times.iter().map(|t| (t - mean).powi(2)).sum::<f64>() / count;
    // Beta(a, b) has mean a / (a + b) and variance ab / ((a + b)^2 (a + b + 1)). The bounds are four standard errors.
    let expected = 1.5 / (2.5 * 2.5 * 3.5) * 0.999f64.powi(2);
    assert!(
        (mean - (0.999 * 0.6 + 0.001)).abs() < 4.0 * (expected / count).sqrt(),
        "{mean}"
    );
    assert!(
        (variance - expected).abs() < 4.0 * expected / count.sqrt(),
        "{variance}"
    );
    // Only one in a hundred thousand samples of that distribution is farther from it.
    let found = distance(times);
    assert!(found < 2.47 / count.sqrt(), "{found}");
}

#[test]
fn flow_times_are_distributed_as_lerobots() {
    let mut rng = ChaCha20Rng::seed_from_u64(1);
    let times = (0..100_000).map(|_| f64::from(flow_time(&mut rng)));
    moments_and_distance_are_lerobots(times.collect());
}

/// Checks the times of ten thousand steps, as they are drawn for training.
#[test]
fn times_of_training_are_flow_times() {
    let config = Profile::Micro.config();
    let steps = (0..10_000).flat_map(|step| order::draws(&config, 3, step, 2));
    moments_and_distance_are_lerobots(steps.map(|draw| f64::from(draw.time)).collect());
}

/// Checks the two ends. A sample of draws cannot tell them from 0 and 1.
#[test]
fn flow_times_begin_at_a_thousandth_and_end_at_one() {
    struct Same(u64);
    impl RngCore for Same {
        fn next_u32(&mut self) -> u32 {
            (self.0 >> 32) as u32
        }
        fn next_u64(&mut self) -> u64 {
            self.0
        }
        fn fill_bytes(&mut self, bytes: &mut [u8]) {
            bytes.fill(self.0 as u8);
        }
    }
    assert_eq!(flow_time(&mut Same(0)), 0.001);
    assert_eq!(flow_time(&mut Same(u64::MAX)), 1.0);
}

#[test]
fn uniform_times_are_told_apart() {
    let mut rng = ChaCha20Rng::seed_from_u64(1);
    let times = (0..100_000).map(|_| 0.999 * uniform(&mut rng) + 0.001);
    assert!(distance(times.collect()) > 0.1);
}
