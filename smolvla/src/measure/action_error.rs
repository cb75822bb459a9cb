//! Sampled actions and their distance from a demonstration's.

use candle_core::Tensor;
use zk0_lerobot::config::PolicyConfig;
use zk0_lerobot::dataset::Normalizer;

use crate::error::{PolicyError, Result};
use crate::frames::batch::Batch;
use crate::measure::evaluate::FlowDraw;
use crate::policy::model::expert::ExpertModel;
use crate::policy::model::sampling;

/// [`sampling::sample_actions`] for a batch: (B, chunk, max_action_dim), normalised, from each sample's noise in `draws`.
///
/// # Errors
/// [`PolicyError::Options`] for 0 steps, [`PolicyError::Sample`] for draws that do not fit.
pub fn sample_actions(
    expert: &ExpertModel,
    batch: &Batch,
    draws: &[FlowDraw],
    steps: usize,
) -> Result<Tensor> {
    let noise: Vec<f32> = draws.iter().flat_map(|d| d.noise.iter().copied()).collect();
    if noise.len() != batch.actions.elem_count() {
        return Err(PolicyError::Sample(format!(
            "{} values of noise for {} of action",
            noise.len(),
            batch.actions.elem_count()
        )));
    }
    let noise = Tensor::from_vec(noise, batch.actions.shape(), batch.actions.device())?;
    sampling::sample_actions(expert, &batch.cache, &noise, steps)
}

/// Absolute errors per action dimension, in the recording's units.
#[derive(Clone, Debug, PartialEq)]
pub struct ActionError {
    sums: Vec<f64>,
    frames: usize,
}

impl ActionError {
    /// No frames yet, of `dims` action dimensions.
    pub fn new(dims: usize) -> Self {
        Self {
            sums: vec![0.0; dims],
            frames: 0,
        }
    }

    /// Adds a batch's sampled chunks (B, chunk, max_action_dim). `normalizer` normalised both. Padding does not count.
    ///
    /// # Errors
    /// [`PolicyError::Sample`] if the normaliser or the chunks do not fit.
    pub fn add(
        &mut self,
        config: &PolicyConfig,
        normalizer: &Normalizer,
        sampled: &Tensor,
        batch: &Batch,
    ) -> Result<()> {
        let (dims, wide) = (self.sums.len(), config.max_action_dim);
        let shape = (batch.is_pad.len(), config.chunk_size, wide);
        let fits = normalizer.dim() == dims
            && dims <= wide
            && sampled.dims3()? == shape
            && batch.actions.dims3()? == shape;
        if !fits {
            return Err(PolicyError::Sample(format!(
                "actions of {} dimensions in chunks {:?} and {:?} are not {dims} dimensions in chunks {shape:?}",
                normalizer.dim(),
                sampled.dims(),
                batch.actions.dims()
            )));
        }
        let plain = |x: &Tensor| -> Result<Vec<f32>> { Ok(x.flatten_all()?.to_vec1()?) };
        let (sampled, shown) = (plain(sampled)?, plain(&batch.actions)?);
        let frames = sampled.chunks_exact(wide).zip(shown.chunks_exact(wide));
        let real = frames.zip(batch.is_pad.iter().flatten());
        for ((sampled, shown), _) in real.filter(|(_, pad)| !**pad) {
            let (mut a, mut b) = (sampled[..dims].to_vec(), shown[..dims].to_vec());
            normalizer.denormalize(&mut a);
            normalizer.denormalize(&mut b);
            for (sum, (a, b)) in self.sums.iter_mut().zip(a.iter().zip(&b)) {
                *sum += (f64::from(*a) - f64::from(*b)).abs();
            }
            self.frames += 1;
        }
        Ok(())
    }

    /// Frames seen.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// Mean absolute error per dimension; 0 without frames.
    pub fn means(&self) -> Vec<f64> {
        let frames = self.frames.max(1) as f64;
        self.sums.iter().map(|sum| sum / frames).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::model::key_values::PrefixCache;
    use crate::policy::profile::Profile;
    use candle_core::{DType, Device};

    #[test]
    fn errors_are_in_the_recordings_units_and_leave_padding_out() {
        let config = Profile::Micro.config();
        let (chunk, wide) = (config.chunk_size, config.max_action_dim);
        let deviations = (1..=6).map(|d| d as f32).collect();
        let normalizer = Normalizer::new(vec![5.0; 6], deviations).unwrap();
        let shape = (2, chunk, wide);
        let sampled = Tensor::ones(shape, DType::F32, &Device::Cpu).unwrap();
        let mut is_pad = vec![vec![false; chunk]; 2];
        is_pad[1][3] = true;
        let shown = is_pad.iter().flatten().flat_map(|pad| {
            let value = if *pad { 101.0f32 } else { 3.0 };
            std::iter::repeat_n(value, wide)
        });
        let shown = Tensor::from_iter(shown, &Device::Cpu).unwrap();
        let batch = Batch {
            cache: PrefixCache {
                keys: Vec::new(),
                values: Vec::new(),
                valid: Vec::new(),
            },
            actions: shown.reshape(shape).unwrap(),
            is_pad,
        };
        let mut error = ActionError::new(6);
        error.add(&config, &normalizer, &sampled, &batch).unwrap();
        assert_eq!(error.frames(), 2 * chunk - 1);
        for (dim, mean) in error.means().into_iter().enumerate() {
            assert!(
                (mean - 2.0 * (dim + 1) as f64).abs() < 1e-5,
                "{dim}: {mean}"
            );
        }
        let other = Normalizer::new(vec![0.0; 5], vec![1.0; 5]).unwrap();
        assert!(error.add(&config, &other, &sampled, &batch).is_err());
    }
}
