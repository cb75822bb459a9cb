//! The sinusoidal embedding of the flow time.

use std::f64::consts::PI;

/// `cat(sin, cos)` of `2 pi time / period`, with geometric periods from `min_period` to `max_period`. In `f64`, because arguments reach
/// 1571 rad (`f32` is off by 1e-4). `width` is even and at least 4.
pub fn time_embedding(time: f32, width: usize, min_period: f64, max_period: f64) -> Vec<f64> {
    let half = width / 2;
    let angles: Vec<f64> = (0..half)
        .map(|k| {
            let period = min_period * (max_period / min_period).powf(k as f64 / (half - 1) as f64);
            1.0 / period * 2.0 * PI * f64::from(time)
        })
        .collect();
    angles
        .iter()
        .map(|a| a.sin())
        .chain(angles.iter().map(|a| a.cos()))
        .collect()
}
