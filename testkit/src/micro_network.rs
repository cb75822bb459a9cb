//! A network of the profile `micro`, and its policy.

use std::path::{Path, PathBuf};
use tempfile::TempDir;
use zk0_circuits::claim::student::Confidence;
use zk0_circuits::claim::t_test::TTest;
use zk0_circuits::model::weights::QuantisedWeights;
use zk0_circuits::vm::merkle;
use zk0_circuits::{
    Digest, Disclosure, EvalSpec, Mode, NodeId, PrivateInput, Terms, WeightsDigest,
};
use zk0_node::recording::evaluation_set::{EvaluationSet, EvaluationSetSpec};
use zk0_node::recording::secret::RegistrationSecret;
use zk0_node::recording::OpenRecording;
use zk0_protocol::entries::signed::DatasetRegistration;
use zk0_protocol::rules::bindings::ExpectedClaim;
use zk0_smolvla::frames::batch::SampleSource;
use zk0_smolvla::frames::prefix_cache::DiskCache;
use zk0_smolvla::frames::sample::PreparedSample;
use zk0_smolvla::measure::fixed_point::quantise_weights;
use zk0_smolvla::policy::init::init_policy;
use zk0_smolvla::policy::policy_file::{self, PolicyFile};
use zk0_smolvla::Profile;

/// Hides the samples.
pub const SECRET: RegistrationSecret = RegistrationSecret::new([3; 32]);

/// A recording of 245 frames.
pub fn pickplace() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/fixtures/datasets/so100_pickplace")
}

/// A network and its policy.
pub struct Setting {
    /// The policy with its tokenizer.
    pub file: PolicyFile,
    /// How it evaluates.
    pub spec: EvalSpec,
    /// The network.
    pub network: Digest,
    /// How it proves.
    pub mode: Mode,
    dir: TempDir,
}

impl Default for Setting {
    fn default() -> Self {
        Self::new()
    }
}

impl Setting {
    /// With an untrained policy.
    pub fn new() -> Self {
        let policy = init_policy(&Profile::Micro.config(), 1).unwrap();
        Self::of(PolicyFile::hashing_words(policy))
    }

    /// With this policy.
    pub fn of(file: PolicyFile) -> Self {
        let setting = Self {
            file,
            spec: EvalSpec::micro(),
            network: Digest([7; 32]),
            mode: Mode::Direct,
            dir: tempfile::tempdir().unwrap(),
        };
        let PolicyFile { policy, tokenizer } = &setting.file;
        policy_file::save(policy, tokenizer, None, &setting.policy()).unwrap();
        setting
    }

    /// The policy's file.
    pub fn policy(&self) -> PathBuf {
        self.dir.path().join("policy.safetensors")
    }

    /// An evaluation set of `frames` frames, with its samples in `folder`.
    pub fn set(
        &self,
        recording: &OpenRecording,
        samples: &dyn SampleSource<PreparedSample>,
        folder: &Path,
        frames: u32,
    ) -> EvaluationSet {
        self.set_under(SECRET, recording, samples, folder, frames)
    }

    /// [`Self::set`] under another secret.
    pub fn set_under(
        &self,
        secret: RegistrationSecret,
        recording: &OpenRecording,
        samples: &dyn SampleSource<PreparedSample>,
        folder: &Path,
        frames: u32,
    ) -> EvaluationSet {
        let by = EvaluationSetSpec {
            network: self.network,
            mode: self.mode,
            frames,
            secret,
        };
        EvaluationSet::prepare(recording, samples, &self.spec, by, folder).unwrap()
    }

    /// Registers `frames` frames of a recording, with the list.
    pub fn registered(
        &self,
        path: &Path,
        cache: Option<&DiskCache>,
        frames: u32,
    ) -> (DatasetRegistration, Vec<u8>) {
        let recording = OpenRecording::open(path, &self.policy(), cache).unwrap();
        let maker = recording.maker();
        let folder = tempfile::tempdir().unwrap();
        let samples = recording.samples(&maker);
        let set = self.set(&recording, &samples, folder.path(), frames);
        set.registration(NodeId([1; 32]))
    }

    /// A claim about `count` samples.
    pub fn expected(&self, set: &EvaluationSet, challenge: u8, count: u32) -> ExpectedClaim {
        ExpectedClaim {
            terms: Terms {
                network: self.network,
                round: 0,
                node: NodeId([1; 32]),
                dataset: set.commitment,
                evaluation: self.spec.digest(),
                base: WeightsDigest::default(),
                update: WeightsDigest::default(),
                challenge: Digest([challenge; 32]),
                eval_samples: count,
                test: TTest {
                    min_improvement_bps: 1,
                    confidence: Confidence::P99,
                },
            },
            disclosure: Disclosure::Losses,
        }
    }

    /// The quantised weights.
    pub fn weights(&self) -> QuantisedWeights {
        quantise_weights(&self.spec, &self.file.policy.expert).unwrap()
    }

    /// Checks samples against the committed tree.
    pub fn check_openings(&self, input: &PrivateInput) {
        let dataset = &input.header.terms.dataset;
        for opening in &input.openings {
            let leaf = opening.leaf(&input.header);
            let (root, size) = (&dataset.root, dataset.samples);
            assert!(merkle::verify(
                root,
                size,
                opening.index,
                &leaf,
                &opening.path
            ));
        }
    }
}
