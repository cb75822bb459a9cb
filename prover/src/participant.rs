//! A node's life in a network: prepare the recording, then round after round train, commit, prove, submit.

use crate::{
    node::{Decision, Node, NodeError},
    program::GuestInput,
    progress::{self, Progress},
    recording::Recording,
    rpc,
    service::{ClientError, ProvingClient},
};
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};
use std::{
    fs, io,
    path::{Path, PathBuf},
};
use zk0_circuits::{
    challenge::DrawError, program::verifying_key, spec::EvalSpec, statement, Claim, Digest, Losses,
    WeightsDigest, CLAIM_VERSION,
};
use zk0_ledger::{bindings::ExpectedClaim, entry::RoundOpened, rules::Disclosure};
use zk0_smolvla::{
    fixed_point::{dims, quantise_weights},
    policy_file::{self, PolicyFile},
    prefix_cache::{CacheError, DiskCache},
    train::{train, TrainOptions},
    ExpertWeights, Policy,
};

/// Largest policy file a node downloads: the published policy takes 1.8 GB.
const MAX_POLICY_BYTES: u64 = 4 << 30;

/// Who takes part, and with what.
pub struct Participant {
    /// The recording: a LeRobotDataset v3.0 folder.
    pub dataset: PathBuf,
    /// Where the node keeps its salt, its updates and its training histories.
    pub state: PathBuf,
    /// Where prepared samples are kept from start to start.
    pub cache: Option<DiskCache>,
    /// How it trains.
    pub training: Training,
    /// Whether it does what it claims.
    pub conduct: Conduct,
}

/// Local training in each round.
#[derive(Clone, Copy, Debug)]
pub struct Training {
    /// Optimiser steps.
    pub steps: usize,
    /// Samples per step.
    pub batch_size: usize,
    /// Learning rate.
    pub learning_rate: f64,
    /// FedProx: weight of the pull towards the round's base weights.
    pub fedprox_mu: f64,
}

/// What a node does with its turn.
#[derive(Clone, Debug)]
pub enum Conduct {
    /// Trains and proves.
    Honest,
    /// Submits the base weights, claims that the loss is half of what it was, and passes these bytes off as the proof. For
    /// demonstrations and tests: an honest network refuses it.
    Lazy {
        /// A proof of something else.
        proof: Vec<u8>,
    },
}

/// Why a node cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum ParticipantError {
    /// The recording.
    #[error("the recording: {0}")]
    Dataset(#[from] zk0_smolvla::dataset::DatasetError),
    /// The recording, or how it fits the policy.
    #[error("the recording: {0}")]
    Prepare(#[from] zk0_smolvla::recording::PrepareError),
    /// The cache of prepared samples.
    #[error(transparent)]
    Cache(#[from] CacheError),
    /// The policy, its weights, or training.
    #[error("the policy: {0}")]
    Policy(#[from] zk0_smolvla::PolicyError),
    /// Values outside the ranges that the round's specification can hold.
    #[error("fixed point: {0}")]
    Quantise(#[from] zk0_circuits::weights::QuantiseError),
    /// The network's evaluation specification.
    #[error("the network's evaluation specification: {0}")]
    Spec(#[from] zk0_circuits::spec::SpecError),
    /// The network was founded with another guest program than this version of zk0 has.
    #[error("the network proves with another program than this version of zk0 has: join with the version it was founded with")]
    OtherProgram,
    /// The policy and the evaluation specification are not of the same dimensions.
    #[error("the network's policy and its evaluation specification differ in dimensions; its founder has to mend that")]
    Dimensions,
    /// The challenge cannot be drawn.
    #[error("the challenge: {0}")]
    Draw(#[from] DrawError),
    /// The claim does not hold: the update is not better by enough on the samples drawn.
    #[error("the update cannot be proven: {0}")]
    Statement(#[from] statement::StatementError),
    /// The aggregator.
    #[error("the aggregator: {0}")]
    Node(#[from] NodeError),
    /// The proving service.
    #[error("the proving service: {0}")]
    Prover(#[from] ClientError),
    /// A file of the node's own.
    #[error("{path}: {error}")]
    File {
        /// Which.
        path: PathBuf,
        /// Why.
        error: io::Error,
    },
    /// A file of the node's own that does not hold what it should.
    #[error("{path} is not what this node wrote there: {why}; move it away to start anew")]
    BrokenFile {
        /// Which.
        path: PathBuf,
        /// What is wrong.
        why: String,
    },
    /// The machine.
    #[error("the system gives no random bytes: {0}")]
    Random(getrandom::Error),
}

/// Training losses of one round, kept beside the update.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct TrainingHistory {
    /// The round.
    pub round: u64,
    /// The batch's loss before each step.
    pub losses: Vec<f32>,
}

impl TrainingHistory {
    fn path(state: &Path, round: u64) -> PathBuf {
        state.join(format!("round-{round}.training.json"))
    }

    /// What the node with this state folder wrote in `round`; `None` if it did not train.
    pub fn read(state: &Path, round: u64) -> Result<Option<Self>, ParticipantError> {
        let path = Self::path(state, round);
        match fs::read(&path) {
            Ok(bytes) => match serde_json::from_slice(&bytes) {
                Ok(history) => Ok(Some(history)),
                Err(error) => Err(ParticipantError::BrokenFile {
                    path,
                    why: error.to_string(),
                }),
            },
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(ParticipantError::File { path, error }),
        }
    }
}

impl Participant {
    /// Takes part in `rounds` rounds. A round in which the update cannot be proven, or is refused, is lost; the next one is
    /// another chance.
    pub async fn run(
        &self,
        node: &mut Node,
        prover: &mut ProvingClient,
        rounds: u64,
    ) -> Result<(), ParticipantError> {
        let genesis = node.genesis();
        if genesis.program != verifying_key(genesis.mode) {
            return Err(ParticipantError::OtherProgram);
        }
        let spec = EvalSpec::decode(&genesis.evaluation)?;
        let blob = genesis.policy;
        let file = policy_file::read(&node.download(&blob, MAX_POLICY_BYTES).await?)?;
        check_dimensions(&file.policy, &spec)?;
        tracing::info!("preparing the recording {}", self.dataset.display());
        let recording = self.recording(&file, &spec)?;
        node.register(&recording).await?;
        tracing::info!(
            "committed to {} samples, root {}",
            recording.commitment.samples,
            recording.commitment.root
        );

        let mut next = 0;
        for _ in 0..rounds {
            let opened = node.wait_for_round(next).await?;
            next = opened.round + 1;
            let turn = Turn {
                participant: self,
                policy: &file.policy,
                spec: &spec,
                recording: &recording,
                opened: &opened,
            };
            match turn.play(node, prover).await {
                Ok(Decision { refusal: None, .. }) => {
                    tracing::info!("round {}: accepted", opened.round)
                }
                Ok(Decision {
                    refusal: Some(reason),
                    ..
                }) => tracing::warn!("round {}: refused: {reason}", opened.round),
                Err(ParticipantError::Statement(error)) => {
                    tracing::warn!(
                        "round {}: not submitted, the update cannot be proven: {error}",
                        opened.round
                    );
                }
                Err(error) => return Err(error),
            }
            let closed = node.wait_for_close(opened.round).await?;
            tracing::info!(
                "round {} closed, {} contributions averaged",
                closed.round,
                closed.contributors.len()
            );
        }
        Ok(())
    }

    /// The prepared recording, under a salt that stays the same from start to start.
    fn recording(&self, file: &PolicyFile, spec: &EvalSpec) -> Result<Recording, ParticipantError> {
        let path = self.state.join("salt");
        let salt = match fs::read(&path) {
            Ok(bytes) => match <[u8; 32]>::try_from(&bytes[..]) {
                Ok(salt) => salt,
                Err(_) => {
                    let why = format!("{} bytes instead of 32", bytes.len());
                    return Err(ParticipantError::BrokenFile { path, why });
                }
            },
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                let mut salt = [0; 32];
                getrandom::fill(&mut salt).map_err(ParticipantError::Random)?;
                write(&path, &salt)?;
                salt
            }
            Err(error) => return Err(ParticipantError::File { path, error }),
        };
        Recording::prepare(&self.dataset, file, spec, salt, self.cache.as_ref())
    }
}

/// One node's part in one round.
struct Turn<'a> {
    participant: &'a Participant,
    policy: &'a Policy,
    spec: &'a EvalSpec,
    recording: &'a Recording,
    opened: &'a RoundOpened,
}

impl Turn<'_> {
    async fn play(
        &self,
        node: &mut Node,
        prover: &mut ProvingClient,
    ) -> Result<Decision, ParticipantError> {
        let round = self.opened.round;
        let rules = &self.opened.rules;
        let limit = rules.max_base_bytes();
        let base_file = node.download(&self.opened.base.blob, limit).await?;
        let base = ExpertWeights::from_safetensors(&self.policy.config, &base_file)?;
        let update = match self.participant.conduct {
            Conduct::Honest => self.train(&base)?,
            Conduct::Lazy { .. } => base.clone(),
        };
        let update_file = update.to_safetensors()?;
        let (quantised_base, quantised) = (
            quantise_weights(self.spec, &base)?,
            quantise_weights(self.spec, &update)?,
        );
        let digest = WeightsDigest {
            blob: Digest(Sha256::digest(&update_file).into()),
            quantised: quantised.digest(node.genesis().mode),
        };
        write(
            &self
                .participant
                .state
                .join(format!("round-{round}.safetensors")),
            &update_file,
        )?;

        node.upload(round, &update_file).await?;
        let challenge = node
            .commit(round, &self.recording.commitment.root, &digest)
            .await?;
        tracing::info!(
            "round {round}: committed to update {}, challenge {challenge}",
            digest.blob
        );

        let expected = ExpectedClaim {
            network: *node.network(),
            round,
            node: node.id(),
            dataset: self.recording.commitment,
            evaluation: self.opened.evaluation,
            base: self.opened.base,
            update: digest,
            challenge,
            eval_samples: rules.eval_samples,
            min_improvement_bps: rules.min_improvement_bps,
            disclosure: rules.disclosure,
        };
        let (claim, proof) = match &self.participant.conduct {
            Conduct::Honest => {
                let witness =
                    self.recording
                        .witness(self.spec, &expected, quantised_base, quantised)?;
                // A second here spares minutes of proving what is not so.
                let (claim, input) = GuestInput::of(node.genesis().mode, &witness)?;
                let proof = prover.prove(input, proving_progress).await?;
                tracing::info!(
                    "round {round}: proven, {} cycles in {} s, {} bytes",
                    proof.cycles,
                    proof.proving_ms / 1000,
                    proof.proof.len()
                );
                (claim, proof.proof)
            }
            Conduct::Lazy { proof } => (pretended(&expected), proof.clone()),
        };
        if let Some((before, after)) = claim.losses.means(self.spec) {
            tracing::info!("round {round}: submitting the claim that the loss went from {before:.4} to {after:.4}");
        }
        Ok(node.submit(claim, proof).await?)
    }

    fn train(&self, base: &ExpertWeights) -> Result<ExpertWeights, ParticipantError> {
        let round = self.opened.round;
        let training = &self.participant.training;
        let options = TrainOptions {
            steps: training.steps,
            batch_size: training.batch_size,
            learning_rate: training.learning_rate,
            fedprox_mu: training.fedprox_mu,
            seed: round,
            ..TrainOptions::default()
        };
        tracing::info!("round {round}: training {} steps", training.steps);
        let mut progress = Progress::start("training", training.steps as u64);
        let trained = train(
            &self.policy.config,
            base,
            &self.recording.samples,
            &options,
            &mut |step| {
                progress.reached(step.step as u64);
            },
        )?;
        let history = TrainingHistory {
            round,
            losses: trained.losses,
        };
        let path = TrainingHistory::path(&self.participant.state, round);
        let json = serde_json::to_vec(&history).map_err(|error| ParticipantError::BrokenFile {
            path: path.clone(),
            why: error.to_string(),
        })?;
        write(&path, &json)?;
        Ok(trained.weights)
    }
}

/// Passes on what the proving service says of a claim's way.
fn proving_progress(event: rpc::Progress) {
    let phase = match event.phase() {
        rpc::progress::Phase::Queued => "waiting for the prover",
        rpc::progress::Phase::Proving => "proving",
        // Over in a second, and nothing is known of the time yet.
        _ => return,
    };
    let total = event.estimated_total_ms.max(event.elapsed_ms + 1);
    progress::report(phase, event.elapsed_ms, total, total - event.elapsed_ms);
}

/// What a lazy node would like to have proven.
fn pretended(expected: &ExpectedClaim) -> Claim {
    Claim {
        version: CLAIM_VERSION,
        network: expected.network,
        round: expected.round,
        node: expected.node,
        dataset: expected.dataset,
        evaluation: expected.evaluation,
        base: expected.base,
        update: expected.update,
        challenge: expected.challenge,
        eval_samples: expected.eval_samples,
        min_improvement_bps: expected.min_improvement_bps,
        losses: match expected.disclosure {
            Disclosure::Nothing => Losses::Hidden,
            Disclosure::Losses => Losses::Disclosed {
                before: 2 << 24,
                after: 1 << 24,
                elements: 1,
            },
        },
        weight_check: None,
    }
}

/// A node that trained at other dimensions than it proves would find out after minutes of work: check first.
fn check_dimensions(policy: &Policy, spec: &EvalSpec) -> Result<(), ParticipantError> {
    match dims(&policy.config)? == spec.dims {
        true => Ok(()),
        false => Err(ParticipantError::Dimensions),
    }
}

/// Writes a file whole or not at all.
fn write(path: &Path, bytes: &[u8]) -> Result<(), ParticipantError> {
    let failed = |error| ParticipantError::File {
        path: path.into(),
        error,
    };
    let unfinished = path.with_extension("unfinished");
    fs::write(&unfinished, bytes).map_err(failed)?;
    fs::File::open(&unfinished)
        .and_then(|file| file.sync_all())
        .map_err(failed)?;
    fs::rename(&unfinished, path).map_err(failed)
}
