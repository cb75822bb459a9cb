//! A mean with its confidence interval.

use serde::{Deserialize, Serialize};
use statrs::distribution::{ContinuousCDF, StudentsT};

/// For normally distributed and independent values.
pub const CONFIDENCE: f64 = 0.95;

/// A mean and its interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Interval {
    /// The mean.
    pub mean: f64,
    /// The lower end.
    pub low: f64,
    /// The upper end.
    pub high: f64,
}

impl Interval {
    /// The mean of some values and its 95 % confidence interval: plus or minus the standard error times the 97.5 % quantile of Student's t
    /// distribution with `values.len() - 1` degrees of freedom. `None` for fewer than two values.
    pub fn of(values: &[f64]) -> Option<Self> {
        let freedom = values.len().checked_sub(1).filter(|freedom| *freedom > 0)? as f64;
        let count = values.len() as f64;
        let mean = values.iter().sum::<f64>() / count;
        let squares = values.iter().map(|value| (value - mean).powi(2));
        let error = (squares.sum::<f64>() / freedom / count).sqrt();
        let quantile = StudentsT::new(0.0, 1.0, freedom)
            .ok()?
            .inverse_cdf(0.5 + CONFIDENCE / 2.0);
        Some(Self {
            mean,
            low: mean - quantile * error,
            high: mean + quantile * error,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assert_near(one: f64, other: f64) {
        assert!((one - other).abs() <= 1e-9 * other.abs(), "{one} {other}");
    }

    /// From scipy 1.17: `stats.t.interval(0.95, len(x) - 1, numpy.mean(x), stats.sem(x))`.
    #[test]
    fn intervals_are_those_of_scipy() {
        let cases: [(&[f64], f64, f64, f64); 3] = [
            (&[1.0, 2.0], 1.5, -4.853102368087347, 7.853102368087347),
            (
                &[0.8123, 0.7991, 0.8204, 0.8052, 0.8110],
                0.8096,
                0.7996763932555593,
                0.8195236067444407,
            ),
            (
                &[
                    -0.013, 0.021, 0.004, -0.007, 0.019, 0.0, 0.011, -0.002, 0.008, 0.015,
                ],
                0.0056,
                -0.002438354070871029,
                0.01363835407087103,
            ),
        ];
        for (values, mean, low, high) in cases {
            let interval = Interval::of(values).unwrap();
            assert_near(interval.mean, mean);
            assert_near(interval.low, low);
            assert_near(interval.high, high);
        }
    }

    #[test]
    fn the_interval_of_equal_values_is_a_point() {
        let interval = Interval::of(&[0.25; 4]).unwrap();
        assert_eq!(
            (interval.mean, interval.low, interval.high),
            (0.25, 0.25, 0.25)
        );
    }

    #[test]
    fn one_value_has_no_interval() {
        assert_eq!(Interval::of(&[]), None);
        assert_eq!(Interval::of(&[1.0]), None);
    }
}
