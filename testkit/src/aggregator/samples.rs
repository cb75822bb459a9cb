//! Public samples for tests.

use zk0_circuits::model::sample::SampleParts;
use zk0_circuits::{EvalSpec, Sample};
use zk0_protocol::rules::closing::public_samples::PublicSamples;
use zk0_verifier::blob_digest;

/// Three samples without padding.
pub fn public_samples() -> Vec<u8> {
    let spec = EvalSpec::micro();
    let dims = &spec.dims;
    let sample = |seed: usize| {
        let list = |count: usize, step: usize| -> Vec<f32> {
            let value = |at: usize| ((at * step + seed * 37) % 201) as f32 / 100.0 - 1.0;
            (0..count).map(value).collect()
        };
        let cache = list(3 * dims.kv_width(), 13);
        let cache: Vec<_> = (0..dims.layers).map(|_| (&cache[..], &cache[..])).collect();
        let width = dims.max_action_dim as usize;
        let mut actions = list(dims.chunk as usize * width, 29);
        for frame in actions.chunks_exact_mut(width) {
            frame[dims.action_dim as usize..].fill(0.0);
        }
        let parts = SampleParts {
            cache: &cache,
            actions: &actions,
            is_pad: &vec![false; dims.chunk as usize],
        };
        Sample::quantise(&spec, parts).unwrap()
    };
    let samples: Vec<_> = (0..3).map(sample).collect();
    samples.iter().flat_map(Sample::as_bytes).copied().collect()
}

/// Names these samples.
pub fn rule_of(samples: &[u8]) -> PublicSamples {
    PublicSamples {
        blob: blob_digest(samples),
        samples: 3,
        max_loss_increase_bps: 500,
    }
}
