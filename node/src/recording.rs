//! A node's own recording: each frame goes through the frozen prefix once, is quantised, and is committed to.

use crate::error::ParticipantError;
use crate::samples::prepare;
use std::collections::BTreeSet;
use std::path::Path;
use std::slice;
use zk0_circuits::claim::dataset::{leaf, salt_commitment};
use zk0_circuits::claim::private_input::{Header, Opening};
use zk0_circuits::model::sample::Sample;
use zk0_circuits::model::spec::EvalSpec;
use zk0_circuits::model::weights::QuantisedWeights;
use zk0_circuits::vm::merkle;
use zk0_circuits::{DatasetCommitment, Digest, PrivateInput};
use zk0_lerobot::dataset::Dataset;
use zk0_protocol::rules::bindings::ExpectedClaim;
use zk0_smolvla::frames::prefix_cache::{DiskCache, FrameMaker, FrameNames, KeySpace};
use zk0_smolvla::frames::sample::{PreparedSample, Preparer};
use zk0_smolvla::measure::fixed_point::quantise_sample;
use zk0_smolvla::policy::frozen::FrozenPlace;
use zk0_smolvla::policy::policy_file::PolicyFile;

/// A prepared recording, as training and proving use it.
pub struct Recording {
    /// For training: f32, in dataset order.
    pub samples: Vec<PreparedSample>,
    /// What the network learns about it.
    pub commitment: DatasetCommitment,
    /// The leaf hashes, in dataset order.
    pub leaves: Vec<Digest>,
    /// The digests of its episodes, in ascending order and without repetition.
    pub episodes: Vec<Digest>,
    salt: [u8; 32],
    quantised: Vec<Sample>,
}

impl Recording {
    /// Reads the LeRobotDataset in `path`, runs the frozen half of the network's policy over it, and commits to the result under `salt`.
    /// The policy's tokenizer reads the instructions. Samples that are in `cache` are not computed again; they are the same bits.
    pub fn prepare(
        path: &Path,
        file: &PolicyFile,
        spec: &EvalSpec,
        salt: [u8; 32],
        cache: Option<&DiskCache>,
    ) -> Result<Self, ParticipantError> {
        let dataset = Dataset::open(path)?;
        let samples = prepare_samples(&dataset, file, cache)?;
        let quantised = samples
            .iter()
            .map(|sample| quantise_sample(spec, sample))
            .collect::<Result<Vec<_>, _>>()?;
        let leaves: Vec<Digest> = quantised
            .iter()
            .map(|sample| leaf(&salt, &sample.digest()))
            .collect();
        let chunk = file.policy.config.chunk_size;
        let commitment = DatasetCommitment {
            root: merkle::root(&leaves),
            samples: leaves.len() as u64,
            feature_spec: Digest(dataset.feature_spec_digest(chunk)),
            salt_commitment: salt_commitment(&salt),
        };
        // A repeated episode counts once.
        let episodes: BTreeSet<_> = dataset.episode_digests().map(Digest).collect();
        Ok(Self {
            samples,
            commitment,
            leaves,
            episodes: episodes.into_iter().collect(),
            salt,
            quantised,
        })
    }

    /// All that is needed to prove `expected`: the challenged samples with their paths, and both sets of weights.
    pub fn private_input(
        &self,
        spec: &EvalSpec,
        expected: &ExpectedClaim,
        base: QuantisedWeights,
        update: QuantisedWeights,
    ) -> Result<PrivateInput, ParticipantError> {
        let indices = zk0_circuits::claim::challenge::sample_indices(
            &expected.terms.challenge,
            self.commitment.samples,
            expected.terms.eval_samples,
        )?;
        let openings = indices
            .into_iter()
            .filter_map(|index| {
                let at = usize::try_from(index).ok()?;
                Some(Opening {
                    index,
                    sample: self.quantised.get(at)?.clone(),
                    path: merkle::path(&self.leaves, at)?,
                })
            })
            .collect();
        let header = Header {
            spec: spec.clone(),
            terms: expected.terms,
            disclosure: expected.disclosure,
            salt: self.salt,
        };
        Ok(PrivateInput {
            header,
            base,
            update,
            openings,
        })
    }
}

/// All frames of the recording as samples for training. Samples that are in `cache` are not computed again.
pub fn prepare_samples(
    dataset: &Dataset,
    file: &PolicyFile,
    cache: Option<&DiskCache>,
) -> Result<Vec<PreparedSample>, ParticipantError> {
    let PolicyFile { policy, tokenizer } = file;
    let space = KeySpace::new::<PreparedSample>(policy, &FrozenPlace::default());
    let all: Vec<usize> = (0..dataset.len()).collect();
    let frames =
        FrameNames::new(space, &policy.config, tokenizer, cache).frames(0, dataset, &all)?;
    let maker = FrameMaker::new(slice::from_ref(dataset), policy.config.chunk_size, || {
        Preparer::new(policy, tokenizer)
    });
    Ok(prepare(cache, &maker, frames)?.into_samples()?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;
    use std::path::PathBuf;
    use zk0_lerobot::tokenizer::{Tokenizer, TrainedTokenizer};
    use zk0_smolvla::measure::fixed_point::dims;
    use zk0_smolvla::policy::init::init_policy;
    use zk0_smolvla::Profile;

    fn path() -> PathBuf {
        PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/fixtures/datasets/so100_pickplace")
    }

    fn hashing_words() -> PolicyFile {
        PolicyFile::hashing_words(init_policy(&Profile::Micro.config(), 1).unwrap())
    }

    fn prepared(file: &PolicyFile, cache: Option<&DiskCache>) -> Recording {
        let spec = EvalSpec::new(dims(&file.policy.config).unwrap());
        Recording::prepare(&path(), file, &spec, [3; 32], cache).unwrap()
    }

    /// The commitment does not depend on where the samples come from.
    #[test]
    fn a_commitment_is_the_same_with_and_without_the_cache() {
        let file = hashing_words();
        let dir = tempfile::tempdir().unwrap();
        let plain = prepared(&file, None);
        for _ in 0..2 {
            let cache = DiskCache::open(dir.path(), 1 << 30).unwrap();
            let cached = prepared(&file, Some(&cache));
            assert_eq!(cached.commitment, plain.commitment);
            assert_eq!(cached.leaves, plain.leaves);
            assert_eq!(cached.samples, plain.samples);
        }
    }

    /// The tokens are those of the policy's tokenizer, and samples of other tokens are not taken from the cache.
    #[test]
    fn instructions_are_read_with_the_policy_s_own_tokenizer() {
        let hashed = hashing_words();
        // This tokenizer knows no word of the recording. Each word becomes token 5.
        let definition = json!({
            "version": "1.0", "truncation": null, "padding": null, "added_tokens": [],
            "normalizer": null, "pre_tokenizer": {"type": "Whitespace"}, "post_processor": null, "decoder": null,
            "model": {"type": "WordLevel", "vocab": {"?": 5}, "unk_token": "?"}
        });
        let config = &hashed.policy.config;
        let trained = TrainedTokenizer::parse(&definition.to_string(), config).unwrap();
        assert_eq!(trained.tokens("one two three").unwrap(), [5, 5, 5]);
        let dataset = Dataset::open(path()).unwrap();
        let preparer = Preparer::new(&hashed.policy, &trained).unwrap();
        let expected = preparer.prepare_every(&dataset, 1, |_, _| {}).unwrap();
        let own = PolicyFile {
            policy: hashed.policy.clone(),
            tokenizer: trained.into(),
        };

        let dir = tempfile::tempdir().unwrap();
        let cache = DiskCache::open(dir.path(), 1 << 30).unwrap();
        let without = prepared(&hashed, Some(&cache));
        for cache in [None, Some(&cache)] {
            let with = prepared(&own, cache);
            assert_eq!(with.samples, expected);
            assert_ne!(with.commitment.root, without.commitment.root);
        }
        assert_eq!(prepared(&hashed, Some(&cache)).samples, without.samples);
    }
}
