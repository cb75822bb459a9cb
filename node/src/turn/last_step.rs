//! The last global step, for FedCM. The node verifies the ledger entries that name it.

use crate::client::NodeClient;
use crate::error::ParticipantError;
use crate::exchanged_weights::Base;
use crate::turn::Turn;
use zk0_smolvla::ExpertWeights;

impl Turn<'_> {
    /// The weights that the round before started from. `None` without a last global step (in the first round, on a base that a vote
    /// restored, and after a round that kept its base), and if the file cannot be downloaded.
    pub(super) async fn earlier(
        &self,
        node: &mut NodeClient,
    ) -> Result<Option<ExpertWeights>, ParticipantError> {
        let round = self.opened.round;
        let Some(before) = round.checked_sub(1) else {
            tracing::info!("round {round}: it is the first, so FedCM has no last global step");
            return Ok(None);
        };
        let (opened, closed) = node.closed_round(before).await?;
        let why = match self.opened.base {
            base if base != closed.global => "a vote restored the weights that it starts from",
            base if base == opened.base => "the round before kept its base",
            _ => {
                let limit = self.weights_limit();
                match node.download(&opened.base.blob, limit).await {
                    Ok(file) => {
                        let format = &self.entered.format;
                        let base = Base::read(format, self.entered.config, &file)?;
                        return Ok(Some(base.weights));
                    }
                    Err(error) => {
                        tracing::warn!("round {round}: the weights {} that round {before} started from cannot be downloaded ({error}), so this round trains without FedCM", opened.base.blob);
                        return Ok(None);
                    }
                }
            }
        };
        tracing::info!("round {round}: FedCM has no last global step, because {why}");
        Ok(None)
    }
}
