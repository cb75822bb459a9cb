//! Prunes when a round has closed, as `zk0 ledger prune` does ([`zk0_ledger::prune`]). Only the copy of the state and the signature hold
//! the aggregator. Files that no entry names stay, because a request may be about to name them. If something fails, the rounds go on, and
//! the next end of a round tries again.

use crate::round::request_error::RequestError;
use crate::serve::service::{blocking, Service};
use zk0_ledger::blobs::usage::Amount;
use zk0_ledger::prune::{PrunePlan, Retention};

impl Service {
    /// Keeps what an audit needs of the last so many closed rounds. Each end of a round deletes older updates.
    pub fn with_kept_rounds(mut self, rounds: u64) -> Self {
        self.keep_rounds = Some(rounds);
        self
    }

    /// Prunes each time a round has closed, until the aggregator cannot go on.
    pub(super) async fn prune_rounds(&self) -> RequestError {
        if self.keep_rounds.is_none() {
            return std::future::pending().await;
        }
        let keep = Retention {
            rounds: self.keep_rounds,
            ..Retention::default()
        };
        loop {
            self.round_closed.notified().await;
            if let Err(error) = self.prune(keep).await {
                tracing::warn!("old rounds are not pruned, and this is tried again when the next round has closed: {error}");
            }
        }
    }

    async fn prune(&self, keep: Retention) -> Result<(), RequestError> {
        let now = self.with(|aggregator| {
            // A dispute that has arrived may still be recorded.
            let now_ms = aggregator.arrivals().earliest_ms()?;
            Ok((aggregator.prunable(), now_ms))
        });
        let (ledger, now_ms) = now.await?;
        let plan = blocking(move || Ok(ledger.plan(&keep, now_ms)?.beside_writer())).await?;
        let (first_kept, mut freed) = (plan.first_kept, Amount::default());
        let pruned = self.delete(plan, &mut freed).await;
        if freed.blobs > 0 {
            tracing::info!(
                blobs = freed.blobs,
                bytes = freed.bytes,
                first_kept,
                "old updates are deleted that no audit of the kept rounds reads"
            );
        }
        pruned
    }

    /// Deletes part after part, and adds to what is `freed`.
    async fn delete(&self, mut plan: PrunePlan, freed: &mut Amount) -> Result<(), RequestError> {
        while !plan.doomed.is_empty() {
            let part;
            (plan, part) = {
                // No end of a round is being computed then: its result is recorded, or it begins after this part.
                let _alone = self.stepping.lock().await;
                let doom = self.with(move |aggregator| {
                    let part = aggregator.doom(&mut plan)?;
                    Ok((plan, part))
                });
                doom.await?
            };
            let deleted = blocking(move || Ok(part.carry_out()?)).await;
            self.with(|aggregator| {
                aggregator.deleted();
                Ok(())
            })
            .await?;
            self.changed.notify_one();
            let deleted = deleted?;
            freed.blobs += deleted.blobs;
            freed.bytes += deleted.bytes;
        }
        Ok(())
    }
}
