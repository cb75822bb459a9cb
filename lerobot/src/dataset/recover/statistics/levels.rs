//! The statistics of an episode's pictures. The count of each level of each colour suffices, so no picture is kept.
//!
//! The sums are exact. LeRobot adds levels and their squares in float32: where a colour is nearly constant, its deviation is wrong and can
//! be 0.

use crate::dataset::recover::statistics::columns::{Statistics, BINS, QUANTILES};
use crate::dataset::recover::statistics::sampling::pixel_step;

/// The largest level, 1 in statistics.
const WHITE: f64 = 255.0;

/// Counts of each level of red, green and blue in the added pictures.
pub(crate) struct Levels {
    counts: [[u64; 256]; 3],
    pictures: u64,
}

impl Levels {
    pub fn new() -> Self {
        Self {
            counts: [[0; 256]; 3],
            pictures: 0,
        }
    }

    /// Adds a picture, `[3, height, width]`.
    pub fn add(&mut self, rgb: &[u8], height: usize, width: usize) {
        let step = pixel_step(height, width);
        for (counts, plane) in self.counts.iter_mut().zip(rgb.chunks(height * width)) {
            for row in plane.chunks(width).step_by(step) {
                for &level in row.iter().step_by(step) {
                    counts[usize::from(level)] += 1;
                }
            }
        }
        self.pictures += 1;
    }

    /// A value per colour, from 0 to 1; at least one picture was added.
    pub fn statistics(&self) -> Statistics {
        let of = |f: &dyn Fn(&[u64; 256]) -> f64| -> Vec<f64> {
            self.counts.iter().map(|counts| f(counts) / WHITE).collect()
        };
        Statistics {
            min: of(&|counts| least(counts).into()),
            max: of(&|counts| greatest(counts).into()),
            mean: of(&mean),
            std: of(&deviation),
            quantiles: QUANTILES
                .iter()
                .map(|(_, q)| of(&|counts| quantile(counts, *q)))
                .collect(),
            count: self.pictures,
        }
    }
}

fn least(counts: &[u64; 256]) -> u8 {
    levels(counts).map(|(level, _)| level).next().unwrap_or(0)
}

fn greatest(counts: &[u64; 256]) -> u8 {
    levels(counts).map(|(level, _)| level).last().unwrap_or(0)
}

fn levels(counts: &[u64; 256]) -> impl Iterator<Item = (u8, u64)> + '_ {
    let all = (0..=u8::MAX).zip(counts.iter().copied());
    all.filter(|(_, count)| *count > 0)
}

fn mean(counts: &[u64; 256]) -> f64 {
    average(counts, f64::from)
}

fn deviation(counts: &[u64; 256]) -> f64 {
    let mean = mean(counts);
    average(counts, |level| (f64::from(level) - mean).powi(2)).sqrt()
}

fn average(counts: &[u64; 256], of: impl Fn(u8) -> f64) -> f64 {
    let sum: f64 = levels(counts).map(|(level, n)| of(level) * n as f64).sum();
    sum / counts.iter().sum::<u64>() as f64
}

/// LeRobot's quantile: counts levels in bins and interpolates within a bin. The bins' edges are float32, which decides between two bins.
fn quantile(counts: &[u64; 256], q: f64) -> f64 {
    let (first, last) = (edge(counts, 0), edge(counts, BINS));
    let target = q * counts.iter().sum::<u64>() as f64;
    let mut below = 0;
    for (level, count) in levels(counts) {
        if (below + count) as f64 >= target {
            let bin = bin(counts, level);
            if bin == 0 {
                return first.into();
            }
            let (start, end) = (edge(counts, bin), edge(counts, bin + 1));
            let fraction = (target - below as f64) / count as f64;
            return f64::from(start) + fraction * f64::from(end - start);
        }
        below += count;
    }
    last.into()
}

/// A level's bin: the last whose lower edge is not above it.
fn bin(counts: &[u64; 256], level: u8) -> usize {
    let (mut low, mut high) = (0, BINS - 1);
    while low < high {
        let middle = (low + high).div_ceil(2);
        if edge(counts, middle) <= f32::from(level) {
            low = middle;
        } else {
            high = middle - 1;
        }
    }
    low
}

/// A bin's lower edge, as numpy's `linspace` gives it in float32.
fn edge(counts: &[u64; 256], bin: usize) -> f32 {
    let min = f32::from(least(counts)) - 1e-10;
    let max = f32::from(greatest(counts)) + 1e-10;
    let (range, bins) = (max - min, BINS as f32);
    match bin {
        BINS => max,
        bin => bin as f32 * (range / bins) + min,
    }
}
