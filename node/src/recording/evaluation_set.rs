//! The samples that a node's claims are about, in fixed point. A hash of the recording's episodes draws their frames. They stay on disk;
//! one at a time is made or read.

use crate::error::ParticipantError;
use crate::progress::Progress;
use crate::recording::opened_samples::{OpenedSample, OpenedSamples};
use crate::recording::sample_files::SampleFiles;
use crate::recording::secret::RegistrationSecret;
use crate::recording::OpenRecording;
use std::borrow::Cow;
use std::path::Path;
use zk0_argument::claim::committed;
use zk0_circuits::claim::challenge::sample_indices;
use zk0_circuits::claim::dataset::{leaf, salt_commitment};
use zk0_circuits::claim::private_input::Header;
use zk0_circuits::model::weights::QuantisedWeights;
use zk0_circuits::vm::digest::tagged_sha256;
use zk0_circuits::vm::merkle;
use zk0_circuits::{DatasetCommitment, Digest, EvalSpec, Mode, NodeId};
use zk0_protocol::entries::signed::{DatasetRegistration, RegisteredEpisode};
use zk0_protocol::evaluation_set::{distinct, draw, list_bytes, DrawnLeaf};
use zk0_protocol::rules::bindings::ExpectedClaim;
use zk0_smolvla::frames::batch::SampleSource;
use zk0_smolvla::frames::prefix_cache::CacheKey;
use zk0_smolvla::frames::sample::PreparedSample;
use zk0_smolvla::measure::fixed_point::quantise_sample;
use zk0_smolvla::PolicyError;

/// Who commits, in which network, and to how many frames.
#[derive(Clone)]
pub struct EvaluationSetSpec {
    /// The network.
    pub network: Digest,
    /// How claims are proven: it determines what is committed to.
    pub mode: Mode,
    /// Number of drawn frames.
    pub frames: u32,
    /// What hides the samples.
    pub secret: RegistrationSecret,
}

/// A node's evaluation set.
pub struct EvaluationSet {
    /// What the network learns about it.
    pub commitment: DatasetCommitment,
    /// The specification of the evaluation, at the samples' scales.
    pub spec: EvalSpec,
    /// Digest of the drawn samples' cache names. It does not depend on the secret.
    pub drawn_names: Digest,
    by: EvaluationSetSpec,
    episodes: Vec<RegisteredEpisode>,
    list: Vec<DrawnLeaf>,
    leaves: Vec<Digest>,
    /// In the order of the leaves.
    samples: Vec<DrawnSample>,
    /// The drawn frames in ascending order, counted in the recording.
    frames: Vec<usize>,
    files: SampleFiles,
}

struct DrawnSample {
    /// Its frame in the recording.
    frame: usize,
    key: CacheKey,
    digest: Digest,
}

impl EvaluationSet {
    /// Draws the frames, and makes the samples that `folder` lacks, one at a time, from `samples`, which are all frames.
    ///
    /// # Errors
    /// The frames cannot be drawn, or a sample cannot be made, does not fit the specification, or cannot be written.
    pub fn prepare(
        recording: &OpenRecording,
        samples: &dyn SampleSource<PreparedSample>,
        spec: &EvalSpec,
        by: EvaluationSetSpec,
        folder: &Path,
    ) -> Result<Self, ParticipantError> {
        let episodes = recording.episodes();
        let drawn = draw(&by.network, &episodes, by.frames).map_err(ParticipantError::Frames)?;
        let files = SampleFiles::open(folder, by.mode, spec, &by.secret)?;
        let mut progress = Progress::start("preparing the evaluation set", drawn.len() as u64);
        let (mut list, mut all) = (Vec::new(), Vec::<DrawnSample>::new());
        let salt = by.secret.salt();
        for frame in drawn {
            let place = recording.frame(frame).ok_or_else(|| missing(frame))?;
            let key = recording.key(place);
            let digest = match files.find(&key) {
                Some(digest) => digest,
                None => files.put(
                    &key,
                    &quantise_sample(spec, samples.sample(place)?.as_ref())?,
                )?,
            };
            list.push(DrawnLeaf {
                frame,
                leaf: leaf(&salt, &digest),
            });
            all.push(DrawnSample {
                frame: place,
                key,
                digest,
            });
            progress.reached(list.len() as u64);
        }
        let names: Vec<_> = all.iter().map(|kept| &kept.key.0[..]).collect();
        let drawn_names = tagged_sha256("zk0/drawn-samples/v1", &names);
        let leaves = distinct(&list);
        let mut frames: Vec<usize> = all.iter().map(|kept| kept.frame).collect();
        frames.sort_unstable();
        let mut next = leaves.iter().peekable();
        let firsts = list
            .iter()
            .zip(all)
            .filter_map(|(drawn, kept)| next.next_if(|leaf| **leaf == drawn.leaf).map(|_| kept));
        let samples: Vec<DrawnSample> = firsts.collect();
        let commitment = DatasetCommitment {
            root: merkle::root(&leaves),
            samples: leaves.len() as u64,
            feature_spec: recording.feature_spec(),
            salt_commitment: salt_commitment(&salt),
        };
        Ok(Self {
            commitment,
            spec: spec.clone(),
            drawn_names,
            by,
            episodes,
            list,
            leaves,
            samples,
            frames,
            files,
        })
    }

    /// The registration by `node`, and the list of drawn frames that it names.
    pub fn registration(&self, node: NodeId) -> (DatasetRegistration, Vec<u8>) {
        let list = list_bytes(&self.list);
        let registration = DatasetRegistration {
            network: self.by.network,
            node,
            dataset: self.commitment,
            evaluation_frames: self.by.frames,
            leaves: zk0_circuits::vm::digest::sha256(&[&list]),
            episodes: self.episodes.clone(),
        };
        (registration, list)
    }

    /// What hides the samples.
    pub fn secret(&self) -> &RegistrationSecret {
        &self.by.secret
    }

    /// The drawn frames as samples for measuring a loss, from `all` frames.
    pub fn drawn<'a>(&'a self, all: &'a dyn SampleSource<PreparedSample>) -> EvaluationSamples<'a> {
        EvaluationSamples {
            frames: &self.frames,
            all,
        }
    }

    /// The private input for proving `expected`: the challenged samples with their paths, and both sets of weights. The samples stay on
    /// disk. A damaged one is made again, from `all` frames.
    ///
    /// # Errors
    /// The challenge asks for more samples than there are, or a damaged sample cannot be made again.
    pub fn private_input(
        &self,
        all: &dyn SampleSource<PreparedSample>,
        expected: &ExpectedClaim,
        base: QuantisedWeights,
        update: QuantisedWeights,
    ) -> Result<OpenedSamples, ParticipantError> {
        let indices = sample_indices(
            &expected.terms.challenge,
            self.commitment.samples,
            expected.terms.eval_samples,
        )?;
        let mut openings = Vec::with_capacity(indices.len());
        for index in indices {
            let at = usize::try_from(index).map_err(|_| missing(index))?;
            let kept = self.samples.get(at).ok_or_else(|| missing(index))?;
            self.check(all, kept)?;
            openings.push(OpenedSample {
                index,
                file: self.files.path(&kept.key, &kept.digest),
                path: merkle::path(&self.leaves, at).ok_or_else(|| missing(index))?,
            });
        }
        let header = Header {
            spec: self.spec.clone(),
            terms: expected.terms,
            disclosure: expected.disclosure,
            salt: self.by.secret.salt(),
        };
        Ok(OpenedSamples {
            header,
            base,
            update,
            openings,
        })
    }

    /// Checks a sample's file. Makes a damaged sample again.
    fn check(
        &self,
        all: &dyn SampleSource<PreparedSample>,
        kept: &DrawnSample,
    ) -> Result<(), ParticipantError> {
        let damaged = match self.files.read(&kept.key, &kept.digest) {
            Err(damaged @ ParticipantError::BrokenFile { .. }) => damaged,
            other => return other.map(drop),
        };
        // Without the sample, the node cannot prove what it has committed to.
        tracing::warn!("{damaged}; the node makes the sample again");
        let sample = quantise_sample(&self.spec, all.sample(kept.frame)?.as_ref())?;
        let blind = self.by.secret.blind();
        if committed(self.by.mode, &self.spec, &sample, &blind).digest == kept.digest {
            self.files.put(&kept.key, &sample)?;
            Ok(())
        } else {
            Err(ParticipantError::OtherSample {
                frame: kept.frame,
                damaged: damaged.to_string(),
            })
        }
    }
}

/// The frames of an evaluation set, for measuring a loss.
pub struct EvaluationSamples<'a> {
    frames: &'a [usize],
    all: &'a dyn SampleSource<PreparedSample>,
}

impl SampleSource<PreparedSample> for EvaluationSamples<'_> {
    fn len(&self) -> usize {
        self.frames.len()
    }

    fn sample(&self, index: usize) -> Result<Cow<'_, PreparedSample>, PolicyError> {
        match self.frames.get(index) {
            Some(frame) => self.all.sample(*frame),
            None => Err(missing(index as u64)),
        }
    }
}

fn missing(number: u64) -> PolicyError {
    PolicyError::Sample(format!("the evaluation set has no sample {number}"))
}
