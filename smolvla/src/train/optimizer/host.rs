//! A step as one pass over a tensor in the CPU's memory.

use std::cell::RefCell;

use candle_core::{bail, CpuStorage, InplaceOp2, Layout, Storage, Tensor, Var};
use rayon::prelude::*;

use crate::error::Result;
use crate::train::optimizer::factors::{Factors, Squares};

/// Values per thread at a time. Blocks are summed in order.
const BLOCK: usize = 1 << 14;

pub(super) struct HostSlot {
    mean: Vec<f32>,
    mean_square: Vec<f32>,
    anchor: Option<Vec<f32>>,
}

impl HostSlot {
    /// `anchored` stores the value that the proximal term pulls towards.
    pub fn new(variable: &Var, anchored: bool) -> Result<Self> {
        let count = variable.elem_count();
        Ok(Self {
            mean: vec![0.0; count],
            mean_square: vec![0.0; count],
            anchor: if anchored {
                Some(variable.flatten_all()?.to_vec1()?)
            } else {
                None
            },
        })
    }

    /// `gradient` is contiguous.
    pub fn squares(&self, variable: &Var, gradient: &Tensor, mu: f64) -> Result<Squares> {
        let (stored, layout) = gradient.storage_and_layout();
        let gradient = plain(&stored, layout)?;
        let Some(anchor) = &self.anchor else {
            let sums = in_blocks(gradient.len(), |at| squares(&gradient[at]));
            return Ok(Squares {
                gradient: sums.into_iter().sum(),
                distance: 0.0,
            });
        };
        let (stored, layout) = variable.storage_and_layout();
        let values = plain(&stored, layout)?;
        let sums = in_blocks(gradient.len(), |at| {
            let parts = values[at.clone()].iter().zip(&anchor[at.clone()]);
            let distance: Vec<f32> = parts.map(|(x, start)| x - start).collect();
            let parts = gradient[at].iter().zip(&distance);
            let pulled: Vec<f32> = parts.map(|(g, d)| g + mu as f32 * d).collect();
            (squares(&pulled), squares(&distance))
        });
        let mut all = Squares::default();
        for (gradient, distance) in sums {
            all.add(Squares { gradient, distance });
        }
        Ok(all)
    }

    /// `gradient` is contiguous.
    pub fn update(&mut self, variable: &Var, gradient: &Tensor, by: &Factors) -> Result<()> {
        let step = FusedStep {
            slot: RefCell::new(self),
            by,
        };
        Ok(variable.inplace_op2(gradient, &step)?)
    }

    pub fn moments(&self) -> [&[f32]; 2] {
        [&self.mean, &self.mean_square]
    }

    pub fn restore(&mut self, mean: Vec<f32>, mean_square: Vec<f32>) {
        (self.mean, self.mean_square) = (mean, mean_square);
    }

    fn apply(&mut self, values: &mut [f32], gradient: &[f32], by: &Factors) {
        let constants = Constants::of(by);
        let parts = (&mut self.mean[..], &mut self.mean_square[..]);
        // Small tensors are faster without a thread pool.
        if values.len() <= BLOCK {
            let anchor = self.anchor.as_deref();
            return constants.step(values, gradient, parts.0, parts.1, anchor);
        }
        match &self.anchor {
            None => values
                .par_chunks_mut(BLOCK)
                .zip(gradient.par_chunks(BLOCK))
                .zip(parts.0.par_chunks_mut(BLOCK))
                .zip(parts.1.par_chunks_mut(BLOCK))
                .for_each(|(((x, g), m), v)| constants.step(x, g, m, v, None)),
            Some(anchor) => values
                .par_chunks_mut(BLOCK)
                .zip(gradient.par_chunks(BLOCK))
                .zip(parts.0.par_chunks_mut(BLOCK))
                .zip(parts.1.par_chunks_mut(BLOCK))
                .zip(anchor.par_chunks(BLOCK))
                .for_each(|((((x, g), m), v), start)| constants.step(x, g, m, v, Some(start))),
        }
    }
}

#[derive(Clone, Copy)]
struct Constants {
    mu: f32,
    clip: f32,
    beta1: f32,
    rest1: f32,
    beta2: f32,
    rest2: f32,
    eps: f32,
    keep: f32,
    rate: f32,
    unbias: f32,
}

impl Constants {
    fn of(by: &Factors) -> Self {
        let o = by.options;
        Self {
            mu: by.mu as f32,
            clip: by.clip as f32,
            beta1: o.beta1 as f32,
            rest1: (1.0 - o.beta1) as f32,
            beta2: o.beta2 as f32,
            rest2: (1.0 - o.beta2) as f32,
            eps: o.eps as f32,
            keep: by.keep as f32,
            rate: by.rate as f32,
            unbias: (1.0 / by.root_bias) as f32,
        }
    }

    fn step(
        &self,
        values: &mut [f32],
        gradient: &[f32],
        mean: &mut [f32],
        mean_square: &mut [f32],
        anchor: Option<&[f32]>,
    ) {
        let moments = mean.iter_mut().zip(mean_square);
        let all = values.iter_mut().zip(gradient).zip(moments);
        match anchor {
            None => all.for_each(|((x, g), (m, v))| self.one(x, *g, m, v)),
            Some(anchor) => all.zip(anchor).for_each(|(((x, g), (m, v)), start)| {
                let g = g + self.mu * (*x - start);
                self.one(x, g, m, v);
            }),
        }
    }

    #[inline(always)]
    fn one(&self, x: &mut f32, gradient: f32, m: &mut f32, v: &mut f32) {
        let g = gradient * self.clip;
        *m = self.beta1 * *m + self.rest1 * g;
        *v = self.beta2 * *v + self.rest2 * g * g;
        let root = v.sqrt() * self.unbias + self.eps;
        *x = self.keep * *x - self.rate * (*m / root);
    }
}

struct FusedStep<'a> {
    slot: RefCell<&'a mut HostSlot>,
    by: &'a Factors,
}

impl InplaceOp2 for FusedStep<'_> {
    fn name(&self) -> &'static str {
        "adamw"
    }

    fn cpu_fwd(
        &self,
        values: &mut CpuStorage,
        values_layout: &Layout,
        gradient: &CpuStorage,
        gradient_layout: &Layout,
    ) -> candle_core::Result<()> {
        let (CpuStorage::F32(values), CpuStorage::F32(gradient)) = (values, gradient) else {
            bail!("adamw: variables and gradients must be float32")
        };
        let offsets = (
            values_layout.contiguous_offsets(),
            gradient_layout.contiguous_offsets(),
        );
        let (Some((from, to)), Some((start, end))) = offsets else {
            bail!("adamw: variables and gradients must be contiguous")
        };
        if to - from != end - start {
            bail!(
                "adamw: a gradient of {} values for {}",
                end - start,
                to - from
            )
        }
        let mut slot = self.slot.borrow_mut();
        slot.apply(&mut values[from..to], &gradient[start..end], self.by);
        Ok(())
    }
}

fn plain<'a>(storage: &'a Storage, layout: &Layout) -> candle_core::Result<&'a [f32]> {
    match (storage, layout.contiguous_offsets()) {
        (Storage::Cpu(CpuStorage::F32(values)), Some((from, to))) => Ok(&values[from..to]),
        _ => bail!("adamw: variables and gradients must be contiguous float32 in the CPU's memory"),
    }
}

/// Does `work` on every block of `0..count`; results are in order.
fn in_blocks<R: Send>(count: usize, work: impl Fn(std::ops::Range<usize>) -> R + Sync) -> Vec<R> {
    let block = |i: usize| i * BLOCK..((i + 1) * BLOCK).min(count);
    if count <= BLOCK {
        return vec![work(0..count)];
    }
    let blocks = 0..count.div_ceil(BLOCK);
    blocks.into_par_iter().map(|i| work(block(i))).collect()
}

/// In double precision, in eight interleaved sums.
fn squares(values: &[f32]) -> f64 {
    let mut sums = [0f64; 8];
    let chunks = values.chunks_exact(sums.len());
    for (sum, x) in sums.iter_mut().zip(chunks.remainder()) {
        *sum += f64::from(*x) * f64::from(*x);
    }
    for chunk in chunks {
        for (sum, x) in sums.iter_mut().zip(chunk) {
            *sum += f64::from(*x) * f64::from(*x);
        }
    }
    sums.iter().sum()
}

#[cfg(test)]
mod tests {
    use super::super::{AdamW, AdamWOptions, Optimizer};
    use super::*;
    use candle_core::Device;
    use std::collections::BTreeMap;

    fn numbers(count: usize, seed: u32) -> Vec<f32> {
        (0..count as u32)
            .map(|i| (i.wrapping_mul(2_654_435_761).wrapping_add(seed) as f32 / 2e9) - 1.0)
            .collect()
    }

    fn three_steps(mu: f64) -> (Vec<u32>, Vec<f64>) {
        let variables: BTreeMap<String, Var> = [("large", 100_003), ("small", 7)]
            .into_iter()
            .map(|(name, count)| {
                let values = numbers(count, count as u32);
                let variable = Var::from_vec(values, count, &Device::Cpu).unwrap();
                (name.to_string(), variable)
            })
            .collect();
        let mut optimizer = AdamW::proximal(&variables, AdamWOptions::default(), mu).unwrap();
        let mut norms = Vec::new();
        for _ in 0..3 {
            let cube = |v: &Var| {
                (v.sqr().unwrap() * v.as_tensor())
                    .unwrap()
                    .sum_all()
                    .unwrap()
            };
            let loss = (cube(&variables["large"]) + cube(&variables["small"])).unwrap();
            let stepped = optimizer.step(&loss.backward().unwrap(), 1e-2).unwrap();
            norms.extend([stepped.gradient_norm, stepped.proximal]);
        }
        let bits = variables.values().flat_map(|v| v.to_vec1::<f32>().unwrap());
        (bits.map(f32::to_bits).collect(), norms)
    }

    #[test]
    fn steps_give_the_same_bits_on_one_thread_and_on_many() {
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            pool.unwrap().install(|| three_steps(0.1))
        };
        let alone = on(1);
        assert_eq!(alone, on(3));
        assert_eq!(alone, on(8));
    }

    #[test]
    fn the_proximal_term_pulls_back_and_is_reported() {
        let (free, free_norms) = three_steps(0.0);
        let (held, held_norms) = three_steps(1e3);
        // The distance is 0 before the first step.
        assert_eq!(free_norms[..2], held_norms[..2]);
        assert!(free_norms[1..].iter().step_by(2).all(|term| *term == 0.0));
        assert_eq!(held_norms[1], 0.0);
        assert!(held_norms[3] > 0.0 && held_norms[5] > 0.0);
        let start = numbers(100_003, 100_003);
        let moved = |bits: &[u32]| -> f64 {
            let pairs = bits.iter().zip(&start);
            pairs
                .map(|(bits, start)| f64::from((f32::from_bits(*bits) - start).abs()))
                .sum()
        };
        assert!(moved(&held) < 0.6 * moved(&free));
    }

    #[test]
    fn the_proximal_term_is_that_of_fedprox() {
        let (mu, rate) = (0.7, 1e-2);
        let variable = || Var::from_vec(numbers(50, 3), 50, &Device::Cpu).unwrap();
        let cube = |v: &Var| {
            (v.sqr().unwrap() * v.as_tensor())
                .unwrap()
                .sum_all()
                .unwrap()
        };
        let (ours, written_out) = (variable(), variable());
        let named = |v: &Var| BTreeMap::from([("w".to_string(), v.clone())]);
        let options = AdamWOptions::default();
        let mut fused = AdamW::proximal(&named(&ours), options, mu).unwrap();
        let mut plain = AdamW::new(&named(&written_out), options).unwrap();
        let start = written_out.as_detached_tensor().copy().unwrap();
        for _ in 0..4 {
            let ours = fused.step(&cube(&ours).backward().unwrap(), rate).unwrap();
            let distance = (written_out.as_tensor() - &start).unwrap();
            let term = (distance.sqr().unwrap().sum_all().unwrap() * (0.5 * mu)).unwrap();
            let loss = (cube(&written_out) + &term).unwrap();
            let theirs = plain.step(&loss.backward().unwrap(), rate).unwrap();
            assert!((ours.gradient_norm / theirs.gradient_norm - 1.0).abs() < 1e-6);
            let term = f64::from(term.to_scalar::<f32>().unwrap());
            assert!((ours.proximal - term).abs() <= 1e-5 * term);
        }
        let (a, b) = (
            ours.to_vec1::<f32>().unwrap(),
            written_out.to_vec1::<f32>().unwrap(),
        );
        assert!(a.iter().zip(&b).all(|(x, y)| (x - y).abs() < 1e-6));
    }

    #[test]
    fn a_gradient_that_is_not_finite_changes_nothing() {
        let variable = Var::from_vec(vec![1.0f32, 2.0], 2, &Device::Cpu).unwrap();
        let variables = BTreeMap::from([("w".to_string(), variable.clone())]);
        let mut optimizer = AdamW::new(&variables, AdamWOptions::default()).unwrap();
        let loss = (variable.sum_all().unwrap() * f64::INFINITY).unwrap();
        let error = optimizer.step(&loss.backward().unwrap(), 1e-2).unwrap_err();
        assert!(error.to_string().contains("norm"), "{error}");
        assert_eq!(variable.to_vec1::<f32>().unwrap(), [1.0, 2.0]);
        assert_eq!(optimizer.steps(), 0);
        assert!(optimizer.moments().unwrap()[0]
            .values
            .iter()
            .all(|m| *m == 0.0));
    }
}
