//! The names of a policy's entries: digests of all that the sample depends on.

use rayon::prelude::*;
use sha2::{Digest, Sha256};
use zk0_lerobot::config::PolicyConfig;
use zk0_lerobot::dataset::Dataset;
use zk0_lerobot::tokenizer::Tokenizer;

use crate::error::PolicyError;
use crate::frames::prefix_cache::entry::CacheEntry;
use crate::frames::prefix_cache::error::CacheError;
use crate::frames::prefix_cache::files::FileDigests;
use crate::frames::prefix_cache::key::CacheKey;
use crate::frames::recording::{normalise, PrepareError};
use crate::frames::sample::ObservedSample;
use crate::policy::frozen::FrozenPlace;
use crate::policy::weights::Policy;

/// Version of all code from recording to sample. Raise it when its numbers change.
const PREPROCESSING: u64 = 1;

/// What all samples of a kind from a policy share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct KeySpace([u8; 32]);

impl KeySpace {
    /// For samples of kind `E` from the frozen half of `policy` at `place`. Reads all its weights.
    pub fn new<E: CacheEntry>(policy: &Policy, place: &FrozenPlace) -> Self {
        // Without the state.
        let all = E::KIND != ObservedSample::KIND;
        let matters = |name: &str| all || !name.starts_with("model.state_proj");
        let tensors: Vec<_> = policy.frozen.iter().filter(|(n, _)| matters(n)).collect();
        let digests: Vec<[u8; 32]> = tensors
            .par_iter()
            .map(|(name, tensor)| {
                let mut hash = FieldHasher::new("zk0:tensor:v1");
                hash.text(name);
                hash.number(tensor.shape.len() as u64);
                tensor.shape.iter().for_each(|dim| hash.number(*dim as u64));
                hash.numbers(&tensor.data);
                hash.finish()
            })
            .collect();
        let mut hash = FieldHasher::new("zk0:prefix-cache:v2");
        hash.number(PREPROCESSING);
        hash.text(E::KIND);
        hash.text(&place.name());
        hash.text(&described(&policy.config));
        hash.number(digests.len() as u64);
        digests.iter().for_each(|digest| hash.bytes(digest));
        Self(hash.finish())
    }

    /// Keys of some frames. Reads videos only for their digests.
    ///
    /// # Errors
    /// A frame is missing, a video cannot be read, or the tokenizer fails.
    pub fn keys(
        &self,
        config: &PolicyConfig,
        tokenizer: &dyn Tokenizer,
        dataset: &Dataset,
        frames: &[usize],
        files: &mut FileDigests,
    ) -> Result<Vec<CacheKey>, CacheError> {
        let dataset_error = |error| CacheError::Prepare(PrepareError::Dataset(error));
        let policy_error = |error: PolicyError| CacheError::Prepare(PrepareError::Policy(error));
        let mut loader = dataset.loader(config.chunk_size).map_err(dataset_error)?;
        let mut tokens: Vec<Option<Vec<u32>>> = vec![None; dataset.tasks().len()];
        let mut keys = Vec::with_capacity(frames.len());
        for index in frames {
            let mut frame = loader.motion(*index).map_err(dataset_error)?;
            normalise(dataset, &mut frame);
            let mut hash = FieldHasher::new("zk0:prefix-cache-frame:v1");
            hash.bytes(&self.0);
            let videos = &dataset.episodes()[frame.episode].videos;
            hash.number(videos.len() as u64);
            for (place, (camera, span)) in dataset.cameras().iter().zip(videos).enumerate() {
                let seconds = frame.frame as f64 / f64::from(dataset.fps());
                hash.text(&camera.name);
                hash.number(camera.height as u64);
                hash.number(camera.width as u64);
                match span {
                    Some(span) => {
                        hash.bytes(&files.of(&span.path)?);
                        hash.number((span.from_timestamp + seconds).to_bits());
                    }
                    None => hash.bytes(
                        &loader
                            .stored_picture(place, *index)
                            .map_err(dataset_error)?,
                    ),
                }
            }
            let ids = match &tokens[frame.task_index] {
                Some(ids) => ids,
                None => {
                    let ids = tokenizer
                        .tokens(&frame.task)
                        .map_err(|error| policy_error(error.into()))?;
                    tokens[frame.task_index].insert(ids)
                }
            };
            hash.number(ids.len() as u64);
            ids.iter().for_each(|id| hash.number(u64::from(*id)));
            hash.numbers(&frame.state);
            hash.numbers(&frame.actions);
            hash.number(frame.action_is_pad.len() as u64);
            let flags = frame.action_is_pad.iter();
            flags.for_each(|pad| hash.number(u64::from(*pad)));
            keys.push(CacheKey(hash.finish()));
        }
        Ok(keys)
    }
}

/// A policy without the newer map of camera names keeps its entries.
fn described(config: &PolicyConfig) -> String {
    format!("{config:?}").replace("rename_map: {}, ", "")
}

struct FieldHasher(Sha256);

impl FieldHasher {
    fn new(tag: &str) -> Self {
        let mut fields = Self(Sha256::new());
        fields.text(tag);
        fields
    }

    fn number(&mut self, n: u64) {
        self.0.update(n.to_le_bytes());
    }

    fn bytes(&mut self, bytes: &[u8]) {
        self.number(bytes.len() as u64);
        self.0.update(bytes);
    }

    fn text(&mut self, text: &str) {
        self.bytes(text.as_bytes());
    }

    fn numbers(&mut self, values: &[f32]) {
        self.number(values.len() as u64);
        for values in values.chunks(1 << 12) {
            let bytes: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
            self.0.update(bytes);
        }
    }

    fn finish(self) -> [u8; 32] {
        self.0.finalize().into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::profile::Profile;

    #[test]
    fn a_map_of_cameras_makes_other_entries_and_none_keeps_those_from_before_there_were_maps() {
        let mut config = Profile::Micro.config();
        config.camera_names = vec!["a".into(), "b".into()];
        let before = r#"camera_names: ["a", "b"], rms_norm_eps: 1e-5"#;
        assert!(described(&config).contains(before));
        let without = described(&config);
        config.rename_map = [("c".to_owned(), "a".to_owned())].into();
        assert_ne!(described(&config), without);
    }
}
