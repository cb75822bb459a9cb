//! Random numbers from a ChaCha stream. Releases of a distribution crate may change what a seed gives, so none is used. [`uniform`] and
//! [`index`] give the same bits on every machine; the logarithm of [`normal`] and the power of [`flow_time`] have platform-dependent last
//! bits.

use rand::RngCore;

/// Uniform in the open interval (0, 1), with 53 random bits.
pub fn uniform(rng: &mut impl RngCore) -> f64 {
    ((rng.next_u64() >> 11) as f64 + 0.5) / (1u64 << 53) as f64
}

/// Standard normal, by Marsaglia's polar method.
pub fn normal(rng: &mut impl RngCore) -> f32 {
    loop {
        let (a, b) = (2.0 * uniform(rng) - 1.0, 2.0 * uniform(rng) - 1.0);
        let square = a * a + b * b;
        if square > 0.0 && square < 1.0 {
            return (a * (-2.0 * square.ln() / square).sqrt()) as f32;
        }
    }
}

/// Training's flow time, `0.999 * Beta(1.5, 1) + 0.001`. Beta(1.5, 1) has distribution function x^1.5.
pub fn flow_time(rng: &mut impl RngCore) -> f32 {
    (0.999 * uniform(rng).powf(1.0 / 1.5) + 0.001) as f32
}

/// A uniformly random index below `n`, by multiply-shift: the bias is below n / 2^64.
pub fn index(rng: &mut impl RngCore, n: usize) -> usize {
    ((u128::from(rng.next_u64()) * n as u128) >> 64) as usize
}
