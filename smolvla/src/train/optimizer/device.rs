//! A step as tensor operations, for memory that the CPU cannot reach.

use candle_core::{Tensor, Var};

use crate::error::Result;
use crate::train::optimizer::factors::{Factors, Squares};

pub(super) struct DeviceSlot {
    mean: Tensor,
    mean_square: Tensor,
    anchor: Option<Tensor>,
}

impl DeviceSlot {
    /// `anchored` stores the value that the proximal term pulls towards.
    pub fn new(variable: &Var, anchored: bool) -> Result<Self> {
        let zeros = variable.zeros_like()?;
        Ok(Self {
            mean: zeros.clone(),
            mean_square: zeros,
            anchor: if anchored {
                Some(variable.as_detached_tensor().copy()?)
            } else {
                None
            },
        })
    }

    /// Of the gradient with its proximal part, and of the anchor's distance: (2), on the device.
    pub fn squares(&self, variable: &Var, gradient: &Tensor, mu: f64) -> Result<Tensor> {
        let sum = |x: &Tensor| x.sqr()?.sum_all();
        let squares = match self.distance(variable)? {
            None => {
                let gradient = sum(gradient)?;
                [gradient.clone(), gradient.zeros_like()?]
            }
            Some(distance) => [sum(&(gradient + (&distance * mu)?)?)?, sum(&distance)?],
        };
        Ok(Tensor::stack(&squares, 0)?)
    }

    pub fn update(&mut self, variable: &Var, gradient: &Tensor, by: &Factors) -> Result<()> {
        let o = by.options;
        let mut g = gradient.clone();
        if let Some(distance) = self.distance(variable)? {
            g = (g + (distance * by.mu)?)?;
        }
        if by.clip < 1.0 {
            g = (g * by.clip)?;
        }
        self.mean = ((&self.mean * o.beta1)? + (&g * (1.0 - o.beta1))?)?;
        self.mean_square = ((&self.mean_square * o.beta2)? + (g.sqr()? * (1.0 - o.beta2))?)?;
        let root = ((self.mean_square.sqrt()? / by.root_bias)? + o.eps)?;
        let update = ((&self.mean / root)? * by.rate)?;
        let kept = (variable.as_detached_tensor() * by.keep)?;
        Ok(variable.set(&(kept - update)?)?)
    }

    pub fn moments(&self) -> Result<[Vec<f32>; 2]> {
        let plain = |x: &Tensor| -> Result<Vec<f32>> { Ok(x.flatten_all()?.to_vec1()?) };
        Ok([plain(&self.mean)?, plain(&self.mean_square)?])
    }

    pub fn restore(&mut self, variable: &Var, mean: Vec<f32>, square: Vec<f32>) -> Result<()> {
        let tensor = |x: Vec<f32>| Tensor::from_vec(x, variable.shape(), variable.device());
        (self.mean, self.mean_square) = (tensor(mean)?, tensor(square)?);
        Ok(())
    }

    fn distance(&self, variable: &Var) -> Result<Option<Tensor>> {
        match &self.anchor {
            Some(anchor) => Ok(Some((variable.as_detached_tensor() - anchor)?)),
            None => Ok(None),
        }
    }
}

pub(super) fn total(squares: &[Tensor]) -> Result<Squares> {
    if squares.is_empty() {
        return Ok(Squares::default());
    }
    let all: Vec<Vec<f32>> = Tensor::stack(squares, 0)?.to_vec2()?;
    let mut total = Squares::default();
    for one in all {
        total.add(Squares {
            gradient: f64::from(one[0]),
            distance: f64::from(one[1]),
        });
    }
    Ok(total)
}

#[cfg(test)]
mod tests {
    use super::super::host::HostSlot;
    use super::super::AdamWOptions;
    use super::*;
    use candle_core::Device;

    #[test]
    fn tensor_operations_and_the_fused_pass_agree() {
        let values = |seed: u32| -> Vec<f32> {
            (0..40_000u32)
                .map(|i| ((i.wrapping_mul(2_654_435_761).wrapping_add(seed)) as f32 / 2e9) - 1.0)
                .collect()
        };
        let variable = || Var::from_vec(values(1), (200, 200), &Device::Cpu).unwrap();
        for (mu, clip) in [(0.0, 1.0), (0.01, 0.3)] {
            let (a, b) = (variable(), variable());
            let mut host = HostSlot::new(&a, mu > 0.0).unwrap();
            let mut device = DeviceSlot::new(&b, mu > 0.0).unwrap();
            for step in 1..=3 {
                let options = AdamWOptions::default();
                let by = Factors {
                    options,
                    mu,
                    clip,
                    keep: 0.999,
                    rate: 1e-3 / (1.0 - options.beta1.powi(step)),
                    root_bias: (1.0 - options.beta2.powi(step)).sqrt(),
                };
                let gradient =
                    Tensor::from_vec(values(step as u32 * 77), (200, 200), &Device::Cpu).unwrap();
                let (x, y) = (
                    host.squares(&a, &gradient, mu).unwrap(),
                    total(&[device.squares(&b, &gradient, mu).unwrap()]).unwrap(),
                );
                assert!((x.gradient / y.gradient - 1.0).abs() < 1e-5);
                assert!((x.distance - y.distance).abs() <= 1e-5 * y.distance);
                host.update(&a, &gradient, &by).unwrap();
                device.update(&b, &gradient, &by).unwrap();
            }
            let plain = |v: &Var| -> Vec<f32> { v.flatten_all().unwrap().to_vec1().unwrap() };
            let pairs = plain(&a).into_iter().zip(plain(&b));
            let worst = pairs.map(|(x, y)| (x - y).abs()).fold(0.0, f32::max);
            assert!(worst < 1e-6, "mu {mu}: {worst}");
            let ([m, v], [n, w]) = (host.moments(), device.moments().unwrap());
            assert!(m.iter().zip(&n).all(|(x, y)| (x - y).abs() < 1e-6));
            assert!(v.iter().zip(&w).all(|(x, y)| (x - y).abs() < 1e-6));
        }
    }
}
