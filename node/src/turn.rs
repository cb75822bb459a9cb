//! One node's part in one round: it trains, commits to the update, proves the claim, and submits it.

use crate::base_losses::BaseLosses;
use crate::client::{Decision, Node};
use crate::error::ParticipantError;
use crate::progress::{self, Progress};
use crate::recording::Recording;
use crate::training_history::TrainingHistory;
use crate::{receipts, state_files};
use sha2::{Digest as _, Sha256};
use std::path::Path;
use zk0_circuits::model::spec::EvalSpec;
use zk0_circuits::{Claim, Digest, Terms, WeightsDigest};
use zk0_protocol::counted::counted;
use zk0_protocol::entries::entry::RoundOpened;
use zk0_protocol::rules::bindings::ExpectedClaim;
use zk0_prover::program::GuestInput;
use zk0_prover::rpc;
use zk0_prover::service::ProvingClient;
use zk0_smolvla::measure::fixed_point::quantise_weights;
use zk0_smolvla::train::adaptive::{adapted, Adaptation, Rates};
use zk0_smolvla::train::measured_loss::loss_of;
use zk0_smolvla::train::{train, TrainOptions};
use zk0_smolvla::{ExpertWeights, PolicyConfig};

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
    /// How mu and the learning rate change with the losses of the rounds' base weights.
    pub adaptation: Adaptation,
}

/// What a node has prepared before its first round.
pub struct Entered {
    /// The policy's configuration.
    pub config: PolicyConfig,
    /// The network's evaluation specification.
    pub spec: EvalSpec,
    /// The recording, prepared and committed to.
    pub recording: Recording,
}

/// One node's part in one round.
pub struct Turn<'a> {
    /// The node's state folder.
    pub state: &'a Path,
    /// What it has prepared.
    pub entered: &'a Entered,
    /// The round.
    pub opened: &'a RoundOpened,
}

impl Turn<'_> {
    /// Trains, commits, proves and submits.
    pub async fn play(
        &self,
        training: &Training,
        node: &mut Node,
        prover: &mut ProvingClient,
    ) -> Result<Decision, ParticipantError> {
        let round = self.opened.round;
        let base = self.base(node).await?;
        let update = self.train(
            &base,
            training,
            self.rates(training, node.network(), &base)?,
        )?;
        let update_file = update.to_safetensors()?;
        let (quantised_base, quantised) = (
            quantise_weights(&self.entered.spec, &base)?,
            quantise_weights(&self.entered.spec, &update)?,
        );
        let kept = format!("round-{round}.safetensors");
        state_files::write(&self.state.join(kept), &update_file)?;
        let digest = quantised.digest(node.genesis().mode);
        let expected = self.commit(node, &update_file, digest).await?;
        let input = self.entered.recording.private_input(
            &self.entered.spec,
            &expected,
            quantised_base,
            quantised,
        )?;
        // This check takes a second. Without it, a claim that does not hold would cost minutes of proving.
        let (claim, input) = GuestInput::of(node.genesis().mode, &input)?;
        let proof = prover.prove(input, proving_progress).await?;
        tracing::info!(
            "round {round}: the claim is proven: {} cycles in {} s; the proof has {} bytes",
            proof.cycles,
            proof.proving_ms / 1000,
            proof.proof.len()
        );
        if let Some((before, after)) = claim.losses.means(&self.entered.spec) {
            tracing::info!("round {round}: the node submits the claim that the loss fell from {before:.4} to {after:.4}");
        }
        self.submit(node, claim, proof.proof).await
    }

    /// Downloads the weights that the round starts from.
    pub async fn base(&self, node: &mut Node) -> Result<ExpertWeights, ParticipantError> {
        let limit = self.opened.rules.max_base_bytes();
        let file = node.download(&self.opened.base.blob, limit).await?;
        Ok(ExpertWeights::from_safetensors(
            &self.entered.config,
            &file,
        )?)
    }

    /// Uploads an update, whose digest in fixed point is `quantised`, and commits to it. Returns what the ledger determines of the claim.
    pub async fn commit(
        &self,
        node: &mut Node,
        update: &[u8],
        quantised: Digest,
    ) -> Result<ExpectedClaim, ParticipantError> {
        let (round, rules) = (self.opened.round, &self.opened.rules);
        let dataset = self.entered.recording.commitment;
        let update_digest = WeightsDigest {
            blob: Digest(Sha256::digest(update).into()),
            quantised,
        };
        node.upload(round, update).await?;
        let (challenge, receipt) = node.commit(round, &dataset.root, &update_digest).await?;
        receipts::keep(self.state, receipt)?;
        let blob = update_digest.blob;
        tracing::info!("round {round}: committed to update {blob}, challenge {challenge}");
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
                eval_samples: rules.eval_samples,
                min_improvement_bps: rules.min_improvement_bps,
            },
            disclosure: rules.disclosure,
        })
    }

    /// Submits a claim with its proof, and keeps the receipt of the decision.
    pub async fn submit(
        &self,
        node: &mut Node,
        claim: Claim,
        proof: Vec<u8>,
    ) -> Result<Decision, ParticipantError> {
        let decision = node.submit(claim, proof).await?;
        receipts::keep(self.state, decision.receipt.clone())?;
        Ok(decision)
    }

    /// The rates at which the round is trained. They follow the losses of the base weights so far, if the operator wants that.
    fn rates(
        &self,
        training: &Training,
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
        let dataset = self.entered.recording.commitment.root;
        let kept = BaseLosses::at(self.state, *network, dataset);
        // Samples, noise and times are the same in every round.
        let measure = || {
            Ok(loss_of(
                &self.entered.config,
                base,
                &self.entered.recording.samples,
                0,
            )?)
        };
        let losses = kept.up_to(round, &self.opened.base.blob, measure)?;
        let adapted = adapted(start, training.adaptation, &losses)?;
        tracing::info!("round {round}: {adapted}");
        Ok(adapted.rates)
    }

    fn train(
        &self,
        base: &ExpertWeights,
        training: &Training,
        rates: Rates,
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
        let steps = counted(training.steps as u64, "step", "steps");
        tracing::info!("round {round}: training {steps}");
        let mut progress = Progress::start("training", training.steps as u64);
        let trained = train(
            &self.entered.config,
            base,
            &self.entered.recording.samples,
            &options,
            &mut |step| {
                progress.reached(step.step as u64);
            },
        )?;
        let history = TrainingHistory {
            round,
            losses: trained.losses,
        };
        let path = TrainingHistory::path(self.state, round);
        state_files::write_json(&path, &history)?;
        Ok(trained.weights)
    }
}

/// Reports how far the proving service is with a claim.
fn proving_progress(event: rpc::Progress) {
    let phase = match event.phase() {
        rpc::progress::Phase::Queued => "waiting for the prover",
        rpc::progress::Phase::Proving => "proving",
        // This phase takes a second, and the time of the proof is not known yet.
        _ => return,
    };
    let total = event.estimated_total_ms.max(event.elapsed_ms + 1);
    progress::report(phase, event.elapsed_ms, total, total - event.elapsed_ms);
}
