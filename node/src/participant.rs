//! A node's life in a network: prepare the recording, then round after round train, commit, prove, submit.

use crate::{
    base_losses::BaseLosses,
    client::{Decision, Node},
    client_error::NodeError,
    error::ParticipantError,
    progress::{self, Progress},
    recording::Recording,
    state_files,
};
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};
use std::{
    fs::{self, File},
    io::BufWriter,
    path::{Path, PathBuf},
};
use zk0_circuits::{program::verifying_key, spec::EvalSpec, Claim, Digest, Losses, WeightsDigest};
use zk0_protocol::{
    entries::entry::RoundOpened,
    rules::{bindings::ExpectedClaim, network_rules::Disclosure},
    Receipt, TlogProof,
};
use zk0_prover::{program::GuestInput, rpc, service::ProvingClient};
use zk0_smolvla::{
    adaptive::{adapted, Adaptation, Rates},
    fixed_point::{dims, quantise_weights},
    policy_file::{self, PolicyFile},
    prefix_cache::DiskCache,
    train::{measure::loss_of, train, TrainOptions},
    ExpertWeights, PolicyConfig,
};

/// Largest policy file a node downloads: the published policy takes 1.8 GB.
pub const MAX_POLICY_BYTES: u64 = 4 << 30;

/// Largest training history that is read.
const MAX_HISTORY_BYTES: u64 = 64 << 20;

/// Who takes part, and with what.
pub struct Participant {
    /// The recording: a LeRobotDataset v3.0 folder.
    pub dataset: PathBuf,
    /// Where the node keeps the policy, its salt, its updates, its training histories and its receipts.
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
    /// What lets mu and the learning rate change with the losses of the rounds' base weights.
    pub adaptation: Adaptation,
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
        own_files::read_json(&Self::path(state, round), MAX_HISTORY_BYTES)
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
        let file = self.policy(node, &blob).await?;
        let config = file.policy.config.clone();
        check_dimensions(&config, &spec)?;
        tracing::info!("preparing the recording {}", self.dataset.display());
        let recording = self.recording(&file, &spec)?;
        // The frozen half has done its part: at the published size, 1.4 GB of memory.
        drop(file);
        self.keep(node.register(&recording).await?)?;
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
                config: &config,
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

    /// The network's policy, on disk from the first start on: it is as large as 1.8 GB, and is not held in memory twice.
    async fn policy(&self, node: &mut Node, blob: &Digest) -> Result<PolicyFile, ParticipantError> {
        let path = self.state.join(format!("policy-{blob}.safetensors"));
        if own_files::sha256(&path)? != Some(blob.0) {
            let unfinished = own_files::unfinished(&path);
            let file = File::create(&unfinished).map_err(own_files::at(&unfinished))?;
            let mut out = BufWriter::new(file);
            match node.download_to(blob, MAX_POLICY_BYTES, &mut out).await {
                Err(NodeError::Write(error)) => return Err(own_files::at(&unfinished)(error)),
                downloaded => downloaded?,
            }
            drop(out);
            own_files::put(&unfinished, &path)?;
        }
        Ok(policy_file::load(&path)?)
    }

    /// Keeps a receipt as a C2SP tlog-proof: with it the node shows anyone that the log has signed the entry, whatever the log says later.
    fn keep(&self, receipt: Receipt) -> Result<(), ParticipantError> {
        let receipts = self.state.join("receipts");
        fs::create_dir_all(&receipts).map_err(own_files::at(&receipts))?;
        let path = receipts.join(format!("entry-{}.tlog-proof", receipt.index));
        own_files::write(&path, &TlogProof::from(receipt).encode())
    }

    /// The prepared recording, under a salt that stays the same from start to start.
    fn recording(&self, file: &PolicyFile, spec: &EvalSpec) -> Result<Recording, ParticipantError> {
        let path = self.state.join("salt");
        let salt = match own_files::read(&path, 32)? {
            Some(bytes) => match <[u8; 32]>::try_from(&bytes[..]) {
                Ok(salt) => salt,
                Err(_) => {
                    let why = format!("{} bytes instead of 32", bytes.len());
                    return Err(ParticipantError::BrokenFile { path, why });
                }
            },
            None => {
                let mut salt = [0; 32];
                getrandom::fill(&mut salt).map_err(ParticipantError::Random)?;
                own_files::write(&path, &salt)?;
                salt
            }
        };
        Recording::prepare(&self.dataset, file, spec, salt, self.cache.as_ref())
    }
}

/// One node's part in one round.
struct Turn<'a> {
    participant: &'a Participant,
    config: &'a PolicyConfig,
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
        let base = {
            let file = node.download(&self.opened.base.blob, limit).await?;
            ExpertWeights::from_safetensors(self.config, &file)?
        };
        let update = match self.participant.conduct {
            Conduct::Honest => self.train(&base, self.rates(node.network(), &base)?)?,
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
        let kept = format!("round-{round}.safetensors");
        own_files::write(&self.participant.state.join(kept), &update_file)?;

        node.upload(round, &update_file).await?;
        let (challenge, receipt) = node
            .commit(round, &self.recording.commitment.root, &digest)
            .await?;
        self.participant.keep(receipt)?;
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
        let decision = node.submit(claim, proof).await?;
        self.participant.keep(decision.receipt.clone())?;
        Ok(decision)
    }

    /// What the round is trained at: as the losses of the base weights so far ask for, if they are followed.
    fn rates(&self, network: &Digest, base: &ExpertWeights) -> Result<Rates, ParticipantError> {
        let (round, training) = (self.opened.round, &self.participant.training);
        let start = Rates {
            mu: training.fedprox_mu,
            learning_rate: training.learning_rate,
        };
        if !training.adaptation.is_wanted() {
            return Ok(start);
        }
        let dataset = self.recording.commitment.root;
        let kept = BaseLosses::at(&self.participant.state, *network, dataset);
        // The same samples, noise and times in every round.
        let measure = || Ok(loss_of(self.config, base, &self.recording.samples, 0)?);
        let losses = kept.up_to(round, &self.opened.base.blob, measure)?;
        let adapted = adapted(start, training.adaptation, &losses)?;
        tracing::info!("round {round}: {adapted}");
        Ok(adapted.rates)
    }

    fn train(&self, base: &ExpertWeights, rates: Rates) -> Result<ExpertWeights, ParticipantError> {
        let round = self.opened.round;
        let training = &self.participant.training;
        let options = TrainOptions {
            steps: training.steps,
            batch_size: training.batch_size,
            learning_rate: rates.learning_rate,
            fedprox_mu: rates.mu,
            seed: round,
            ..TrainOptions::default()
        };
        tracing::info!("round {round}: training {} steps", training.steps);
        let mut progress = Progress::start("training", training.steps as u64);
        let trained = train(
            self.config,
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
        own_files::write_json(&path, &history)?;
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
    expected.with(match expected.disclosure {
        Disclosure::Nothing => Losses::Hidden,
        Disclosure::Losses => Losses::Disclosed {
            before: 2 << 24,
            after: 1 << 24,
            elements: 1,
        },
    })
}

/// A node that trained at other dimensions than it proves would find out after minutes of work: check first.
fn check_dimensions(config: &PolicyConfig, spec: &EvalSpec) -> Result<(), ParticipantError> {
    match dims(config)? == spec.dims {
        true => Ok(()),
        false => Err(ParticipantError::Dimensions),
    }
}
