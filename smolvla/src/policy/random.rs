//! The random numbers of initialisation and training, from a ChaCha stream.
//!
//! Written out rather than taken from a distribution crate, whose releases may change what a seed gives.
//! [`uniform`] and [`index`] give the same bits on every machine; [`normal`] and [`flow_time`] use a logarithm
//! and a power, whose last bit is the platform's.

use rand::RngCore;

/// Uniform in the open interval (0, 1), with 53 random bits.
pub fn uniform(rng: &mut impl RngCore) -> f64 {
    ((rng.next_u64() >> 11) as f64 + 0.5) / (1u64 << 53) as f64
}

/// Standard normal, by Marsaglia's polar method (one of the pair; the other is dropped).
pub fn normal(rng: &mut impl RngCore) -> f32 {
    loop {
        let (a, b) = (2.0 * uniform(rng) - 1.0, 2.0 * uniform(rng) - 1.0);
        let square = a * a + b * b;
        if square > 0.0 && square < 1.0 {
            return (a * (-2.0 * square.ln() / square).sqrt()) as f32;
        }
    }
}

/// Flow time of training, `0.999 * Beta(1.5, 1) + 0.001`. Beta(1.5, 1) has distribution function x^1.5.
pub fn flow_time(rng: &mut impl RngCore) -> f32 {
    (0.999 * uniform(rng).powf(1.0 / 1.5) + 0.001) as f32
}

/// A uniformly random index below `n`.
///
/// Multiply-shift: the bias is below n / 2^64.
pub fn index(rng: &mut impl RngCore, n: usize) -> usize {
    ((u128::from(rng.next_u64()) * n as u128) >> 64) as usize
}
