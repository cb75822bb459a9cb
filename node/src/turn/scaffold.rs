//! A round by SCAFFOLD: the node trains by SGD, with the steps and the rate of the rules. Its control variates follow from earlier rounds,
//! whose entries it verifies and whose weights it downloads by their digests. So no control variates travel, and a node that has lost its
//! files computes the same ones again.
//!
//! The rounds that count form an unbroken row up to this one: by the same strategy with the same numbers, each starting from the result of
//! the one before, back to the round in which the rules let the control variates begin with 0. A round whose result was not taken counts
//! for nothing.

use crate::client::NodeClient;
use crate::client_error::NodeError;
use crate::error::ParticipantError;
use crate::exchanged_weights::Base;
use crate::turn::control_variates::{KeptVariates, Whose};
use crate::turn::{LocalTraining, Turn};
use zk0_circuits::Digest;
use zk0_protocol::counted::counted;
use zk0_protocol::entries::entry::{RoundClosed, RoundOpened};
use zk0_protocol::rules::network_rules::{Scaffold, Strategy};
use zk0_smolvla::train::scaffold::{ControlVariates, Correction, PastRound};
use zk0_smolvla::train::schedule::Schedule;
use zk0_smolvla::train::{train_by_sgd, TrainOptions, TrainingSamples};
use zk0_smolvla::ExpertWeights;

impl LocalTraining {
    /// Refuses options that would make the control variates wrong.
    pub(super) fn check_beside_scaffold(&self, round: u64) -> Result<(), ParticipantError> {
        let options = [
            ("--fedprox-mu", self.fedprox_mu != 0.0),
            ("--fedcm-alpha", self.fedcm_alpha != 1.0),
            ("--follow-losses", self.adaptation.follow),
            ("--lr-boost", self.adaptation.boost.is_some()),
        ];
        match options.iter().find(|(_, set)| *set) {
            Some((option, _)) => Err(ParticipantError::BesideScaffold { round, option }),
            None => Ok(()),
        }
    }
}

impl Turn<'_> {
    pub(super) fn train_by_scaffold(
        &self,
        rule: &Scaffold,
        training: &LocalTraining,
        base: &Base,
        correction: Option<&Correction>,
    ) -> Result<ExpertWeights, ParticipantError> {
        let options = TrainOptions {
            steps: rule.steps as usize,
            batch_size: training.batch_size,
            learning_rate: rule.learning_rate(),
            schedule: Schedule::Constant,
            seed: self.opened.round,
            ..TrainOptions::default()
        };
        let (config, samples) = (self.entered.config, self.entered.training);
        let samples = TrainingSamples::Prepared(samples);
        self.followed(training, options.steps, &mut |progress| {
            train_by_sgd(
                &training.device,
                config,
                &base.weights,
                samples,
                &options,
                correction,
                progress,
            )
        })
    }

    pub(super) async fn control_variates(
        &self,
        rule: &Scaffold,
        node: &mut NodeClient,
        base: &Base,
    ) -> Result<ControlVariates, ParticipantError> {
        let round = self.opened.round;
        let whose = Whose {
            network: *node.network(),
            node: node.id(),
            rule: *rule,
        };
        let (config, like) = (self.entered.config, &base.weights);
        let limit = self.weights_limit();
        let mut kept = KeptVariates::read(self.state, &whose, config, limit)?;
        let (mut new, mut next_base, mut found) = (Vec::new(), self.opened.base, None);
        for before in (rule.begins(round)..round).rev() {
            let (opened, closed) = node.closed_round(before).await?;
            if opened.rules.strategy != Strategy::Scaffold(*rule) || closed.global != next_base {
                break;
            }
            if kept.as_ref().is_some_and(|kept| kept.next == before + 1) {
                found = kept.take();
                break;
            }
            next_base = opened.base;
            new.push((opened, closed));
        }
        let mut known =
            found.unwrap_or_else(|| KeptVariates::begin(round - new.len() as u64, like));
        let mut held = None;
        let (mut observed, before) = (Ok(()), known.next);
        for (opened, closed) in new.iter().rev() {
            observed = self
                .observe(&mut known, node, base, &mut held, (opened, closed))
                .await;
            if observed.is_err() {
                break;
            }
            known.next = opened.round + 1;
        }
        if known.next > before {
            if let Err(error) = known.keep(self.state, &whose, config) {
                tracing::warn!("round {round}: the control variates are not kept, and the node computes them again from the ledger: {error}");
            }
        }
        observed?;
        let rounds = counted(round - known.first, "round", "rounds");
        let step = format!(
            "{} of SGD at {}",
            counted(rule.steps.into(), "step", "steps"),
            rule.learning_rate()
        );
        tracing::info!("round {round}: the rules ask for SCAFFOLD with {step}, so --steps and --learning-rate do not count; the control variates rest on {rounds}");
        Ok(known.variates)
    }

    /// Takes a round into account. It starts from the weights `held`, if they are here.
    async fn observe(
        &self,
        known: &mut KeptVariates,
        node: &mut NodeClient,
        base: &Base,
        held: &mut Option<(Digest, ExpertWeights)>,
        (opened, closed): (&RoundOpened, &RoundClosed),
    ) -> Result<(), ParticipantError> {
        let Strategy::Scaffold(rule) = opened.rules.strategy else {
            return Ok(());
        };
        if !closed.is_taken() {
            return Ok(());
        }
        let (from, to) = (opened.base.blob, closed.global.blob);
        let start = match held.take() {
            Some((blob, weights)) if blob == from => weights,
            _ => self.weights(node, &rule, &from).await?,
        };
        let result = if to == self.opened.base.blob {
            None
        } else {
            Some(self.weights(node, &rule, &to).await?)
        };
        let contributors: Vec<_> = closed.contributors.iter().map(|one| one.node).collect();
        let own = if contributors.contains(&node.id()) {
            let update = match node.accepted_update(opened.round).await {
                // A round may have opened meanwhile for which the earlier ones no longer count.
                Err(NodeError::Unexpected { .. })
                    if node.commits_no_more(self.opened.round).await? =>
                {
                    return Err(ParticipantError::TooLate {
                        round: self.opened.round,
                    });
                }
                update => update?,
            };
            Some(self.weights(node, &rule, &update.blob).await?)
        } else {
            None
        };
        let sat_out = known.contributed.iter();
        let sat_out = sat_out.filter(|node| !contributors.contains(node)).count();
        known.variates.observe(&PastRound {
            base: start.tensors(),
            result: result.as_ref().unwrap_or(&base.weights).tensors(),
            own: own.as_ref().map(ExpertWeights::tensors),
            contributed: contributors.len(),
            sat_out,
            way: f64::from(rule.steps) * rule.learning_rate(),
        })?;
        known.contributed.extend(contributors);
        *held = result.map(|result| (to, result));
        Ok(())
    }

    async fn weights(
        &self,
        node: &mut NodeClient,
        rule: &Scaffold,
        blob: &Digest,
    ) -> Result<ExpertWeights, ParticipantError> {
        let (round, limit) = (self.opened.round, self.weights_limit());
        let file = node.download(blob, limit).await;
        let file = file.map_err(|error| ParticipantError::NoControlVariates {
            round,
            blob: *blob,
            error: error.into(),
            begins: rule.begins(round) + u64::from(rule.restart_rounds),
        })?;
        Ok(Base::read(&self.entered.format, self.entered.config, &file)?.weights)
    }
}
