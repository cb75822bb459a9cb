//! SCAFFOLD (Karimireddy et al. 2020, arXiv:1910.06378), option II, with control variates from public weights.
//!
//! In Algorithm 1, node i makes K steps `y ← y − η·(g − cᵢ + c)` from the base x. Then `cᵢ⁺ = cᵢ − c + (x − yᵢ) / (K·η)`, and c is the mean
//! of all cᵢ. Nodes send yᵢ and cᵢ⁺. Here they send only yᵢ:
//!
//! - cᵢ follows from x, node i's updates yᵢ, and c.
//! - c follows from the bases. The next base is the mean of the contributors' yᵢ (S), with equal weights. So the mean of `(x − yᵢ) / (K·η)`
//!   over S is `Δ = (x − x⁺) / (K·η)`. With U the earlier contributors, `c⁺ = (|U ∖ S|·c + |S|·Δ) / |U ∪ S|`. For S within U, this is the
//!   paper's `c + (|S| / N)·mean(cᵢ⁺ − cᵢ)`, where N is |U|.
//! - Before its first contribution, a node has cᵢ = c: it joins without a change of the mean, and its first round has no correction. In the
//!   first round all are 0.
//!
//! x⁺ is rounded to int16, so each round moves c from the mean of the cᵢ by up to half a unit of the last place, divided by K·η. Therefore,
//! and because nodes leave with their cᵢ, control variates must restart at 0 after some rounds.

use zk0_tensors::{TensorData, TensorError, TensorSet};

use crate::error::{PolicyError, Result};

/// What is added to a node's gradients: c − cᵢ.
pub type Correction = TensorSet;

/// One node's control variates.
#[derive(Clone, Debug, PartialEq)]
pub struct ControlVariates {
    /// c.
    pub global: TensorSet,
    /// cᵢ; `None` if it is c, before the first contribution.
    pub own: Option<TensorSet>,
}

/// What control variates need of a round.
#[derive(Clone, Copy)]
pub struct PastRound<'a> {
    /// The first weights.
    pub base: &'a TensorSet,
    /// The last weights: the updates' mean, with equal weights.
    pub result: &'a TensorSet,
    /// The node's own accepted update, if any.
    pub own: Option<&'a TensorSet>,
    /// Contributors, |S|.
    pub contributed: usize,
    /// Earlier contributors absent from this round, |U ∖ S|.
    pub sat_out: usize,
    /// Local steps times their learning rate, K·η.
    pub way: f64,
}

impl ControlVariates {
    /// All 0, for weights like these.
    pub fn zero(like: &TensorSet) -> Self {
        let zero = |(name, tensor): (&String, &TensorData)| {
            let zeros = TensorData {
                shape: tensor.shape.clone(),
                data: vec![0.0; tensor.data.len()],
            };
            (name.clone(), zeros)
        };
        Self {
            global: like.iter().map(zero).collect(),
            own: None,
        }
    }

    /// c − cᵢ; `None` for 0.
    pub fn correction(&self) -> Option<Correction> {
        let own = self.own.as_ref()?;
        let difference = |(name, c): (&String, &TensorData)| {
            let pairs = c.data.iter().zip(&own[name].data);
            let data = pairs.map(|(c, own)| c - own).collect();
            let shape = c.shape.clone();
            (name.clone(), TensorData { shape, data })
        };
        Some(self.global.iter().map(difference).collect())
    }

    /// Takes a round into account; one without contributions changes nothing.
    ///
    /// # Errors
    /// [`TensorError`] for weights of another shape, and [`PolicyError::Options`] unless [`PastRound::way`] is positive and finite.
    pub fn observe(&mut self, round: &PastRound<'_>) -> Result<()> {
        if !(round.way > 0.0 && round.way.is_finite()) {
            return Err(PolicyError::Options(format!(
                "the steps of a round by SCAFFOLD have the length {} in all; it must be above 0",
                round.way
            )));
        }
        if round.contributed == 0 {
            return Ok(());
        }
        for (name, c) in &self.global {
            for set in [Some(round.base), Some(round.result), round.own] {
                let tensor = set.map(|set| set.get(name).ok_or(name)).transpose();
                let tensor = tensor.map_err(|name| TensorError::Missing(name.clone()))?;
                tensor.map_or(Ok(()), |tensor| tensor.check_shape(name, &c.shape))?;
            }
        }
        if let Some(update) = round.own {
            let own = self.own.get_or_insert_with(|| self.global.clone());
            for (name, own) in own {
                let (c, base) = (&self.global[name].data, &round.base[name].data);
                let parts = c.iter().zip(base).zip(&update[name].data);
                for (own, ((c, x), y)) in own.data.iter_mut().zip(parts) {
                    let gradient = (f64::from(*x) - f64::from(*y)) / round.way;
                    *own = (f64::from(*own) - f64::from(*c) + gradient) as f32;
                }
            }
        }
        let (sat_out, contributed) = (round.sat_out as f64, round.contributed as f64);
        for (name, c) in &mut self.global {
            let (base, result) = (&round.base[name].data, &round.result[name].data);
            for (c, (x, next)) in c.data.iter_mut().zip(base.iter().zip(result)) {
                let mean = (f64::from(*x) - f64::from(*next)) / round.way;
                *c = ((sat_out * f64::from(*c) + contributed * mean) / (sat_out + contributed))
                    as f32;
            }
        }
        Ok(())
    }
}
