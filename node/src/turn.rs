//! One node's part in one round: it trains, commits to the update, proves the claim, and submits it.

mod control_variates;
mod curves;
mod last_step;
mod lerobot_updates;
pub mod prepared_claim;
pub mod proving;
mod room;
mod scaffold;
pub mod unfinished;

use crate::base_losses::BaseLosses;
use crate::client::NodeClient;
use crate::client_error::NodeError;
use crate::error::ParticipantError;
use crate::exchanged_weights::Base;
use crate::observe::NodePhase;
use crate::progress::Progress;
use crate::recording::evaluation_set::EvaluationSet;
use crate::recording::registering::Registering;
use crate::tensorboard::EventFile;
use crate::training_history::TrainingHistory;
use crate::{receipts, state_files};
use std::path::Path;
use std::sync::Arc;
use tracing::field::Empty;
use tracing::{instrument, Span};
use zk0_circuits::{Claim, Digest, Mode, QuantisedWeights, Terms, WeightsDigest};
use zk0_protocol::blob::blob_digest;
use zk0_protocol::counted::counted;
use zk0_protocol::entries::entry::RoundOpened;
use zk0_protocol::entries::program::Program;
use zk0_protocol::entries::proof_blob::ProofBlob;
use zk0_protocol::entries::refusal::Refusal;
use zk0_protocol::rules::bindings::ExpectedClaim;
use zk0_protocol::rules::network_rules::Strategy;
use zk0_prover::program::PreparedClaim;
use zk0_prover::service::ProvingClient;
use zk0_smolvla::frames::batch::SampleSource;
use zk0_smolvla::frames::sample::PreparedSample;
use zk0_smolvla::measure::fixed_point::dequantise_weights;
use zk0_smolvla::policy::device::Device;
use zk0_smolvla::train::adaptive::{adapted, Adaptation, Rates};
use zk0_smolvla::train::measured_loss::loss_of;
use zk0_smolvla::train::{
    train_on, FedCm, TrainOptions, TrainingResult, TrainingSamples, TrainingStep,
};
use zk0_smolvla::{ExpertWeights, PolicyConfig, PolicyError};
use zk0_weights::Format;

use curves::Curves;
use prepared_claim::prepare;
use proving::have_proven;
use room::{check_room_of_argument, check_room_of_update};
use unfinished::{Decided, ProvenClaim, RoundParticipation, UnfinishedUpdate};

/// Local training in each round.
#[derive(Clone, Debug)]
pub struct LocalTraining {
    /// Where the expert is trained. Samples are always prepared on the CPU, because the dataset commitment is about the CPU's numbers.
    /// Commitments and proofs are about fixed-point numbers, on the CPU.
    pub device: Device,
    /// Optimiser steps.
    pub steps: usize,
    /// Samples per step.
    pub batch_size: usize,
    /// Learning rate.
    pub learning_rate: f64,
    /// FedProx: weight of the pull towards the round's base weights.
    pub fedprox_mu: f64,
    /// FedCM: the node's own share of a step, above 0 and up to 1. The rest follows the last global step.
    pub fedcm_alpha: f64,
    /// How mu and the learning rate follow the losses of the base weights.
    pub adaptation: Adaptation,
    /// Where TensorBoard curves of training are written.
    pub curves: Option<Arc<EventFile>>,
}

/// What a node has prepared before its first round.
pub struct Entered<'a> {
    /// The policy's configuration.
    pub config: &'a PolicyConfig,
    /// How the network's weights look as files.
    pub format: Format,
    /// All frames as they are recorded, for measuring losses and proving.
    pub samples: &'a dyn SampleSource<PreparedSample>,
    /// The frames to train on, or variants of them.
    pub training: &'a dyn SampleSource<PreparedSample>,
    /// The committed samples, for proving.
    pub evaluation: EvaluationSet,
    /// Commits to them again, before the secret is worn out.
    pub registering: &'a Registering<'a>,
}

/// One node's part in one round.
pub struct Turn<'a> {
    /// The node's state folder.
    pub state: &'a Path,
    /// What it has prepared.
    pub entered: &'a Entered<'a>,
    /// The round.
    pub opened: &'a RoundOpened,
    /// The guest program in force in it.
    pub program: &'a Program,
    /// Samples on which the update is evaluated.
    pub eval_samples: u32,
}

impl Turn<'_> {
    /// Returns why the contribution is refused, or `None` if it is accepted.
    #[instrument(name = "turn", skip_all, fields(
        zk0.node = %node.id(),
        zk0.round = self.opened.round,
        zk0.outcome = Empty,
    ))]
    pub async fn play(
        &self,
        training: &LocalTraining,
        node: &mut NodeClient,
        prover: &mut ProvingClient,
    ) -> Result<Option<Refusal>, ParticipantError> {
        let round = self.opened.round;
        let part = self.participation(node);
        if let Some(decided) = Decided::read(self.state, &part)? {
            tracing::info!("round {round}: the node's contribution is decided already; it waits until the round has closed");
            return Ok(decided.refusal.map(Refusal::from));
        }
        if let Strategy::Scaffold(_) = self.opened.rules.strategy {
            training.check_beside_scaffold(round)?;
        }
        let (mode, format) = (node.genesis().mode, &self.entered.format);
        check_room_of_argument(mode, format.spec(), self.eval_samples, self.state)?;
        let kept = UnfinishedUpdate::read(self.state, &part, self.weights_limit())?;
        if kept.is_none() {
            if node.commits_no_more(round).await? {
                return Err(ParticipantError::TooLate { round });
            }
            check_room_of_update(format, self.state)?;
        }
        let base = self.base(node).await?;
        let (update, eval_samples) = match kept {
            Some(kept) => {
                tracing::info!("round {round}: the node was interrupted, and goes on with the update that it has trained");
                (format.read(&kept.file)?, kept.eval_samples)
            }
            None => {
                node.metrics().enters(NodePhase::Training);
                let update = self.update(training, node, &base).await?;
                let kept = UnfinishedUpdate {
                    of: part,
                    eval_samples: self.eval_samples,
                    file: format.write(&update),
                };
                // First of all, so that a full disk cannot take it.
                kept.keep(self.state)?;
                drop(kept);
                if let Err(error) = self.keep_for_lerobot(&update) {
                    tracing::warn!("round {round}: the update is not kept in the form that LeRobot reads: {error}");
                }
                (update, self.eval_samples)
            }
        };
        // What follows takes the most memory of a round, and needs only the base as it travels.
        drop(base.weights);
        let turn = Turn {
            eval_samples,
            ..*self
        };
        node.metrics().enters(NodePhase::Committing);
        let expected = turn.commit(node, &update).await?;
        let (registering, evaluation) = (self.entered.registering, &self.entered.evaluation);
        if let Err(error) = registering.again(node, evaluation).await {
            tracing::warn!("round {round}: the recording is not registered again, and the node tries it again in the next round: {error}");
        }
        let ProvenClaim { claim, proof } = match ProvenClaim::read(self.state, &expected.terms)? {
            Some(kept) => {
                tracing::info!("round {round}: the node was interrupted, and submits the proof that it has made");
                kept
            }
            None => {
                node.metrics().enters(NodePhase::Proving);
                let proven = self.prove(prover, node, &expected, base.quantised, update);
                let proven = proven.await?;
                // The aggregator answers the same proof again, but no other proof of the same claim.
                if let Err(error) = proven.keep(self.state) {
                    tracing::warn!("round {round}: the proof is submitted and not kept: {error}");
                }
                proven
            }
        };
        if let Some((before, after)) = claim.losses.means(format.spec()) {
            tracing::info!("round {round}: the node submits the claim that the loss fell from {before:.4} to {after:.4}");
            Curves::after(training.curves.as_deref(), self.state, round).proven(before, after);
        }
        node.metrics().enters(NodePhase::Submitting);
        let refusal = self.submit(node, claim, proof).await?;
        let outcome = refusal.as_ref().map(ToString::to_string);
        Span::current().record("zk0.outcome", outcome.as_deref().unwrap_or("accepted"));
        let decided = Decided {
            of: part,
            refusal: refusal.as_ref().map(|refusal| refusal.code),
        };
        decided.keep(self.state)?;
        Ok(refusal)
    }

    fn participation(&self, node: &NodeClient) -> RoundParticipation {
        RoundParticipation {
            network: *node.network(),
            round: self.opened.round,
            base: self.opened.base.blob,
            dataset: self.entered.evaluation.commitment.root,
        }
    }

    /// Sends update and proof again, because the aggregator has lost one of them.
    ///
    /// # Errors
    /// The node has not kept them, or the aggregator does not take them.
    pub async fn send_again(&self, node: &mut NodeClient) -> Result<(), ParticipantError> {
        let (round, part) = (self.opened.round, self.participation(node));
        let kept = UnfinishedUpdate::read(self.state, &part, self.weights_limit())?;
        let kept = kept.ok_or(ParticipantError::NotKept { round })?;
        tracing::warn!(
            "round {round}: the aggregator has lost a file of the node's contribution, and the node sends its files again"
        );
        node.upload(round, kept.file).await?;
        if let Some(ProvenClaim { claim, proof }) = ProvenClaim::in_round(self.state, &part)? {
            self.submit(node, claim, proof).await?;
        }
        Ok(())
    }

    /// In mode `succinct`, the node keeps the argument, and goes on with a kept one.
    async fn prove(
        &self,
        prover: &mut ProvingClient,
        node: &mut NodeClient,
        expected: &ExpectedClaim,
        base: QuantisedWeights,
        update: QuantisedWeights,
    ) -> Result<ProvenClaim, ParticipantError> {
        let mode = node.genesis().mode;
        let PreparedClaim {
            claim,
            weight_check,
            mut input,
        } = match unfinished::read_claim(self.state, &expected.terms)? {
            Some(kept) => kept,
            None => {
                let (samples, evaluation) = (self.entered.samples, &self.entered.evaluation);
                let input = evaluation.private_input(samples, expected, base, update)?;
                // A claim that does not hold costs no proof.
                let secret = evaluation.secret().clone();
                let prepared = prepare(mode, input, secret, self.state.to_owned()).await?;
                if mode == Mode::Succinct {
                    unfinished::keep_claim(self.state, &prepared)?;
                }
                prepared
            }
        };
        // The release's own program may not be in force yet.
        input.program.clone_from(&self.program.key);
        let proof = have_proven(prover, node, self.opened, input).await?;
        tracing::info!(
            "round {}: the claim is proven: {} cycles in {} s; the proof has {} bytes",
            self.opened.round,
            proof.cycles,
            proof.proving_ms / 1000,
            proof.proof.len()
        );
        let proof = ProofBlob {
            weight_check: &weight_check,
            sp1: &proof.proof,
        };
        Ok(ProvenClaim {
            proof: proof.join(),
            claim,
        })
    }

    #[instrument(name = "train", skip_all)]
    async fn update(
        &self,
        training: &LocalTraining,
        node: &mut NodeClient,
        base: &Base,
    ) -> Result<QuantisedWeights, ParticipantError> {
        let (config, format) = (self.entered.config, &self.entered.format);
        let trained = match self.opened.rules.strategy {
            Strategy::Scaffold(rule) => {
                // The control variates themselves take memory, and are on disk.
                let correction = self.control_variates(&rule, node, base).await?.correction();
                self.train_by_scaffold(&rule, training, base, correction.as_ref())?
            }
            _ => {
                let earlier = if training.fedcm_alpha < 1.0 {
                    self.earlier(node).await?
                } else {
                    None
                };
                let rates = self.rates(training, node.network(), &base.weights)?;
                let fedcm = earlier.as_ref().map(|earlier| FedCm {
                    alpha: training.fedcm_alpha,
                    earlier,
                });
                self.train(&base.weights, training, rates, fedcm)?
            }
        };
        base.update(format, config, trained)
    }

    fn keep_for_lerobot(&self, update: &QuantisedWeights) -> Result<(), ParticipantError> {
        let (config, format) = (self.entered.config, &self.entered.format);
        let lerobots = dequantise_weights(config, format.spec(), update)?;
        lerobot_updates::keep(self.state, self.opened.round, &lerobots.to_safetensors()?)
    }

    /// Downloads the weights that the round starts from.
    pub async fn base(&self, node: &mut NodeClient) -> Result<Base, ParticipantError> {
        let limit = self.weights_limit();
        let file = node.download(&self.opened.base.blob, limit).await?;
        Base::read(&self.entered.format, self.entered.config, &file)
    }

    /// The aggregator's word about the rules costs no memory beyond this.
    fn weights_limit(&self) -> u64 {
        let allowed = self.opened.rules.max_update_bytes;
        allowed.min(self.entered.format.file_bytes())
    }

    /// Uploads an update, commits to it, and waits for its challenge. Returns the claim's terms.
    pub async fn commit(
        &self,
        node: &mut NodeClient,
        update: &QuantisedWeights,
    ) -> Result<ExpectedClaim, ParticipantError> {
        let (round, rules) = (self.opened.round, &self.opened.rules);
        let dataset = self.entered.evaluation.commitment;
        let file = self.entered.format.write(update);
        let update_digest = WeightsDigest {
            blob: blob_digest(&file),
            quantised: update.digest(node.genesis().mode),
        };
        node.upload(round, file).await?;
        let (root, samples) = (&dataset.root, self.eval_samples);
        let mut committed = node.commit(round, root, &update_digest, samples).await;
        // A machine that was lost had what was uploaded and not committed to.
        if committed.as_ref().is_err_and(NodeError::lacks_update) {
            tracing::warn!(
                "round {round}: the aggregator has lost the upload, and the node sends it again"
            );
            let file = self.entered.format.write(update);
            node.upload(round, file).await?;
            committed = node.commit(round, root, &update_digest, samples).await;
        }
        let (commitment, receipt) = committed?;
        receipts::keep(self.state, node.genesis(), receipt)?;
        let blob = update_digest.blob;
        tracing::info!("round {round}: committed to update {blob}; waiting for the randomness");
        let (challenge, receipt) = node.wait_for_challenge(self.opened, &commitment).await?;
        receipts::keep(self.state, node.genesis(), receipt)?;
        tracing::info!("round {round}: the challenge is {challenge}");
        Ok(ExpectedClaim {
            terms: Terms {
                network: *node.network(),
                round,
                node: node.id(),
                dataset,
                evaluation: self.opened.evaluation,
                base: self.opened.base,
                update: update_digest,
                challenge,
                eval_samples: self.eval_samples,
                test: rules.test(),
            },
            disclosure: rules.disclosure,
        })
    }

    /// Submits a claim with its proof, and keeps the decision's receipt. Returns why the contribution is refused, or `None` if it is
    /// accepted.
    pub async fn submit(
        &self,
        node: &mut NodeClient,
        claim: Claim,
        proof: Vec<u8>,
    ) -> Result<Option<Refusal>, ParticipantError> {
        let decision = node.submit(claim, proof).await?;
        receipts::keep(self.state, node.genesis(), decision.receipt)?;
        Ok(decision.refusal)
    }

    /// The rates of the training. They may follow the losses of the base weights so far.
    fn rates(
        &self,
        training: &LocalTraining,
        network: &Digest,
        base: &ExpertWeights,
    ) -> Result<Rates, ParticipantError> {
        let round = self.opened.round;
        let start = Rates {
            mu: training.fedprox_mu,
            learning_rate: training.learning_rate,
        };
        if !training.adaptation.is_wanted() {
            return Ok(start);
        }
        let kept = BaseLosses::at(self.state, *network, self.entered.evaluation.drawn_names);
        // Samples, noise and times are the same in every round. All frames of a recording could be too many.
        let measure = || {
            let drawn = self.entered.evaluation.drawn(self.entered.samples);
            let loss = loss_of(
                self.entered.config,
                base,
                TrainingSamples::Prepared(&drawn),
                0,
            )?;
            Ok(loss)
        };
        let losses = kept.up_to(round, &self.opened.base.blob, measure)?;
        let adapted = adapted(start, training.adaptation, &losses)?;
        tracing::info!("round {round}: {adapted}");
        Ok(adapted.rates)
    }

    fn train(
        &self,
        base: &ExpertWeights,
        training: &LocalTraining,
        rates: Rates,
        fedcm: Option<FedCm<'_>>,
    ) -> Result<ExpertWeights, ParticipantError> {
        let round = self.opened.round;
        let options = TrainOptions {
            steps: training.steps,
            batch_size: training.batch_size,
            learning_rate: rates.learning_rate,
            fedprox_mu: rates.mu,
            seed: round,
            ..TrainOptions::default()
        };
        let samples = TrainingSamples::Prepared(self.entered.training);
        self.followed(training, training.steps, &mut |progress| {
            train_on(
                &training.device,
                self.entered.config,
                base,
                samples,
                &options,
                fedcm,
                progress,
            )
        })
    }

    fn followed(
        &self,
        training: &LocalTraining,
        steps: usize,
        train: &mut dyn FnMut(&mut dyn FnMut(TrainingStep)) -> Result<TrainingResult, PolicyError>,
    ) -> Result<ExpertWeights, ParticipantError> {
        let round = self.opened.round;
        let counted = counted(steps as u64, "step", "steps");
        tracing::info!("round {round}: training {counted}");
        let mut progress = Progress::start("training", steps as u64);
        let mut curves = Curves::of(training.curves.as_deref(), self.state, round);
        let trained = train(&mut |step| {
            progress.reached(step.step as u64);
            curves.stepped(&step);
        })?;
        // The frozen half takes gigabytes, and is not needed until the next round.
        self.entered.training.rest();
        let history = TrainingHistory {
            round,
            losses: trained.losses,
        };
        let path = TrainingHistory::path(self.state, round);
        if let Err(error) = state_files::write_json(&path, &history) {
            tracing::warn!("round {round}: the losses of the training are not kept: {error}");
        }
        Ok(trained.weights)
    }
}
