//! Statistics of the rows themselves.

/// Of one feature, a value per dimension.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Spread {
    pub min: Vec<f64>,
    pub max: Vec<f64>,
    pub mean: Vec<f64>,
    pub std: Vec<f64>,
    pub rows: usize,
}

impl Spread {
    pub fn of(values: &[f32], dim: usize) -> Self {
        let rows = values.len() / dim.max(1);
        let mut spread = Self {
            min: vec![f64::INFINITY; dim],
            max: vec![f64::NEG_INFINITY; dim],
            mean: vec![0.0; dim],
            std: vec![0.0; dim],
            rows,
        };
        for row in values.chunks_exact(dim.max(1)) {
            for (d, &value) in row.iter().enumerate() {
                let value = f64::from(value);
                spread.min[d] = spread.min[d].min(value);
                spread.max[d] = spread.max[d].max(value);
                spread.mean[d] += value / rows as f64;
            }
        }
        for row in values.chunks_exact(dim.max(1)) {
            for (d, &value) in row.iter().enumerate() {
                let off = f64::from(value) - spread.mean[d];
                spread.std[d] += off * off / rows as f64;
            }
        }
        spread.std.iter_mut().for_each(|std| *std = std.sqrt());
        spread
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_dimension_has_its_own() {
        let spread = Spread::of(&[1.0, -4.0, 3.0, -4.0, 5.0, 8.0, 7.0, 0.0], 2);
        let expected = Spread {
            min: vec![1.0, -4.0],
            max: vec![7.0, 8.0],
            mean: vec![4.0, 0.0],
            std: vec![5f64.sqrt(), 24f64.sqrt()],
            rows: 4,
        };
        assert_eq!(spread, expected);
    }
}
