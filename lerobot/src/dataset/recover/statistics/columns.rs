//! Statistics of an episode's numeric columns, and of all episodes together.
//!
//! Quantiles come from a histogram of 5000 bins per dimension; those of the whole are the episodes' means, weighted by frames. LeRobot
//! computes in float32 for float32 columns, this in float64: the last digits differ.

use arrow_array::cast::AsArray;
use arrow_array::types::{
    Float32Type, Float64Type, Int16Type, Int32Type, Int64Type, Int8Type, UInt16Type, UInt32Type,
    UInt64Type, UInt8Type,
};
use arrow_array::Array;
use arrow_schema::DataType;

pub(crate) const BINS: usize = 5000;
/// LeRobot's quantiles and their names.
pub(crate) const QUANTILES: [(&str, f64); 5] = [
    ("q01", 0.01),
    ("q10", 0.1),
    ("q50", 0.5),
    ("q90", 0.9),
    ("q99", 0.99),
];

/// Statistics of one column, a value per dimension.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Statistics {
    pub min: Vec<f64>,
    pub max: Vec<f64>,
    pub mean: Vec<f64>,
    pub std: Vec<f64>,
    pub quantiles: Vec<Vec<f64>>,
    pub count: u64,
}

impl Statistics {
    /// Of rows of `dim` values, at least one row.
    pub fn of(values: &[f64], dim: usize) -> Self {
        let rows = values.len() / dim;
        let columns: Vec<Vec<f64>> = (0..dim)
            .map(|d| values.iter().skip(d).step_by(dim).copied().collect())
            .collect();
        let of = |f: &dyn Fn(&Vec<f64>) -> f64| columns.iter().map(f).collect::<Vec<f64>>();
        let mean = |column: &Vec<f64>| column.iter().sum::<f64>() / rows as f64;
        let std = |column: &Vec<f64>| {
            let mean = mean(column);
            let squares = column.iter().map(|v| (v - mean).powi(2)).sum::<f64>();
            (squares / rows as f64).sqrt()
        };
        let quantile = |(_, q): &(&str, f64)| match rows {
            1 => of(&mean),
            _ => of(&|column| quantile(column, *q)),
        };
        Self {
            min: of(&|column| column.iter().copied().fold(f64::INFINITY, f64::min)),
            max: of(&|column| column.iter().copied().fold(f64::NEG_INFINITY, f64::max)),
            mean: of(&mean),
            std: of(&std),
            quantiles: QUANTILES.iter().map(quantile).collect(),
            count: rows as u64,
        }
    }

    /// Of all episodes, at least one, with the same dimensions.
    pub fn pooled(episodes: &[&Self]) -> Self {
        let count: u64 = episodes.iter().map(|e| e.count).sum();
        let of = |each: &dyn Fn(usize) -> f64| (0..episodes[0].mean.len()).map(each).collect();
        let weighted = |value: &dyn Fn(&Self) -> f64| {
            let sum: f64 = episodes.iter().map(|e| value(e) * e.count as f64).sum();
            sum / count as f64
        };
        let mean: Vec<f64> = of(&|d| weighted(&|e| e.mean[d]));
        let variance = |d: usize| weighted(&|e| e.std[d].powi(2) + (e.mean[d] - mean[d]).powi(2));
        Self {
            min: of(&|d| {
                episodes
                    .iter()
                    .map(|e| e.min[d])
                    .fold(f64::INFINITY, f64::min)
            }),
            max: of(&|d| {
                episodes
                    .iter()
                    .map(|e| e.max[d])
                    .fold(f64::NEG_INFINITY, f64::max)
            }),
            std: of(&|d| variance(d).sqrt()),
            quantiles: (0..QUANTILES.len())
                .map(|q| of(&|d| weighted(&|e| e.quantiles[q][d])))
                .collect(),
            mean,
            count,
        }
    }

    /// Names and values of all but `count`, in LeRobot's order.
    pub fn entries(&self) -> impl Iterator<Item = (&'static str, &Vec<f64>)> {
        let moments = [
            ("min", &self.min),
            ("max", &self.max),
            ("mean", &self.mean),
            ("std", &self.std),
        ];
        let quantiles = QUANTILES.iter().map(|(name, _)| *name).zip(&self.quantiles);
        moments.into_iter().chain(quantiles)
    }
}

/// LeRobot's quantile: counts values in bins and interpolates within a bin.
fn quantile(values: &[f64], q: f64) -> f64 {
    let min = values.iter().copied().fold(f64::INFINITY, f64::min) - 1e-10;
    let max = values.iter().copied().fold(f64::NEG_INFINITY, f64::max) + 1e-10;
    let width = (max - min) / BINS as f64;
    let edge = |bin: usize| min + width * bin as f64;
    let mut counts = vec![0u64; BINS];
    for value in values {
        let bin = ((value - min) / width) as usize;
        counts[bin.min(BINS - 1)] += 1;
    }
    let target = q * values.len() as f64;
    let mut below = 0;
    for (bin, &count) in counts.iter().enumerate() {
        if (below + count) as f64 >= target {
            return match bin {
                0 => min,
                _ if count == 0 => edge(bin),
                _ => edge(bin) + width * (target - below as f64) / count as f64,
            };
        }
        below += count;
    }
    max
}

/// A column's numbers, row after row, and their number per row; `None` for other columns.
pub(crate) fn numbers(column: &dyn Array) -> Option<(Vec<f64>, usize)> {
    macro_rules! all {
        ($type:ty) => {
            column
                .as_primitive::<$type>()
                .values()
                .iter()
                .map(|&v| v as f64)
                .collect()
        };
    }
    let values = match column.data_type() {
        DataType::FixedSizeList(_, dim) => {
            let values = column.as_fixed_size_list().values();
            return Some((numbers(values)?.0, *dim as usize));
        }
        DataType::Boolean => {
            let values = column.as_boolean().values();
            values.iter().map(|v| u8::from(v).into()).collect()
        }
        DataType::Float32 => all!(Float32Type),
        DataType::Float64 => all!(Float64Type),
        DataType::Int8 => all!(Int8Type),
        DataType::Int16 => all!(Int16Type),
        DataType::Int32 => all!(Int32Type),
        DataType::Int64 => all!(Int64Type),
        DataType::UInt8 => all!(UInt8Type),
        DataType::UInt16 => all!(UInt16Type),
        DataType::UInt32 => all!(UInt32Type),
        DataType::UInt64 => all!(UInt64Type),
        _ => return None,
    };
    Some((values, 1))
}
