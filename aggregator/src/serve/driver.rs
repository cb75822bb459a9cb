//! The driver of the rounds: polls the aggregator, runs its jobs, and hands their results back.

use crate::round::aggregator::Aggregator;
use crate::round::job::{Polled, RoundJob};
use crate::round::phase::RoundStep;
use crate::round::request_error::RequestError;
use crate::serve::service::{blocking, Service, TICK};
use futures_core::future::BoxFuture;
use std::time::Duration;
use tokio::time::{sleep, timeout};
use tracing::Instrument;
use zk0_ledger::clock::ClockError;
use zk0_ledger::folder;
use zk0_protocol::rpc::federation::trouble::Kind;
use zk0_protocol::WitnessPolicy;

/// Each try reads large files, or the whole ledger.
const BLOCKED_RETRY: Duration = Duration::from_secs(5);

impl Service {
    /// Opens and closes rounds in time, and does all else that is due. Returns only when that fails, when the clock has been behind for too
    /// long, or when the rules ask for another witness policy than `witnesses`.
    pub(super) async fn rounds(&self, witnesses: &str) -> RequestError {
        // Steps are retried, so the log states the same reason once.
        let mut reported = String::new();
        loop {
            let polled = match self.step().await {
                Err(error) if !matches!(error, RequestError::Clock(_)) => return error,
                polled => polled,
            };
            self.note_polled(&polled);
            if let Err(error) = self.go_on(witnesses).await {
                return error;
            }
            match polled {
                Ok(Polled::Did(_) | Polled::Run(_)) => reported.clear(),
                Ok(Polled::Idle(until_ms)) => {
                    let now_ms = self.arrivals.now_ms().unwrap_or(u64::MAX);
                    let left = until_ms.and_then(|until_ms| until_ms.checked_sub(now_ms));
                    let left = left.map_or(TICK, |left| TICK.min(Duration::from_millis(left)));
                    let _ = timeout(left, self.changed.notified()).await;
                }
                Ok(Polled::Unanswered(why, retry)) => {
                    if reported != why {
                        tracing::warn!("{why}; the servers are asked again every {retry:?}");
                        reported = why;
                    }
                    sleep(retry).await;
                }
                Ok(Polled::Blocked(why)) => {
                    if reported != why {
                        tracing::error!("{why}; this is tried again every {BLOCKED_RETRY:?}");
                        reported = why;
                        // The round's followers learn of a lost file.
                        self.stage.send_modify(|_| ());
                    }
                    sleep(BLOCKED_RETRY).await;
                }
                Err(error) => {
                    // The text has changing times, so the kind of the message counts.
                    let kind = "the clock is wrong";
                    if reported != kind {
                        tracing::error!("{error}; this is tried again every {BLOCKED_RETRY:?}");
                        reported = kind.into();
                    }
                    if self.gives_up(&error) {
                        return error;
                    }
                    sleep(BLOCKED_RETRY).await;
                }
            }
        }
    }

    /// Whether the service ends because the clock has been behind for too long. A clock that is ahead does not end it: a restarted service
    /// believes its clock, and an entry with a future time could not be undone.
    fn gives_up(&self, error: &RequestError) -> bool {
        let lasting = self.troubles().lasting(Kind::Clock);
        matches!(error, RequestError::Clock(ClockError::LeaptBack { .. }))
            && lasting.is_some_and(|lasting| lasting >= self.limits.clock_behind)
    }

    /// Tells the round's followers the result of a step, and checks that the rounds can go on.
    async fn go_on(&self, witnesses: &str) -> Result<(), RequestError> {
        self.note_stage().await?;
        let witnesses = witnesses.to_owned();
        let check = move |aggregator: &mut Aggregator| {
            aggregator.ledger().check_writable()?;
            if aggregator.state().rules().witness_policy == witnesses {
                return Ok(());
            }
            if aggregator.state().rules().witness_policy.is_empty() {
                // The folder keeps the one that the rules had.
                folder::write_policy(aggregator.ledger().dir(), &WitnessPolicy::none())?;
            }
            let why =
                "the rules have a new witness policy: start the aggregator again with it".into();
            Err(RequestError::Internal(why))
        };
        self.with(check).await
    }

    /// Polls the aggregator and runs its jobs, until there are none. Boxed, so that a crate that awaits it does not compile the steps
    /// again.
    pub fn step(&self) -> BoxFuture<'_, Result<Polled, RequestError>> {
        Box::pin(async {
            let _alone = self.stepping.lock().await;
            let poll = |aggregator: &mut Aggregator| {
                let now_ms = aggregator.arrivals().now_ms()?;
                aggregator.poll(now_ms)
            };
            let mut polled = self.with(poll).await?;
            while let Polled::Run(job) = polled {
                let span = job.span();
                polled = self.ran(job).instrument(span).await?;
            }
            Ok(polled)
        })
    }

    async fn ran(&self, job: RoundJob) -> Result<Polled, RequestError> {
        let beacons = self.beacons.clone();
        let result = match blocking(move || job.run(&beacons)).await? {
            Ok(result) => result,
            Err(polled) => return Ok(polled),
        };
        let polled = self
            .with(move |aggregator| aggregator.finish(result))
            .await?;
        if let Polled::Did(RoundStep::Close(round)) = polled {
            self.count_round(round).await?;
            self.keep_state().await;
            self.round_closed.notify_one();
            self.clear_uploads(round).await?;
        }
        Ok(polled)
    }

    /// Keeps the state for the next start, if much is new. Only its copy holds the aggregator. The rounds go on if that fails, and the next
    /// end of a round tries again.
    async fn keep_state(&self) {
        let kept = async {
            let to_keep = self.with(|aggregator| Ok(aggregator.state_to_keep()));
            let Some(to_keep) = to_keep.await? else {
                return Ok(());
            };
            let written = blocking(move || to_keep.write()).await?;
            self.with(|aggregator| {
                aggregator.note_kept(written);
                Ok(())
            })
            .await
        };
        let kept: Result<(), RequestError> = kept.await;
        if let Err(error) = kept {
            tracing::warn!("the state is not kept for the next start: {error}");
        }
    }

    /// Removes the uploads up to this closed round. The rounds go on if that fails.
    async fn clear_uploads(&self, round: u64) -> Result<(), RequestError> {
        let staging = self.with(|aggregator| Ok(aggregator.staging().clone()));
        let staging = staging.await?;
        let cleared = blocking(move || Ok(staging.clear(round)?));
        if let Err(error) = cleared.await {
            tracing::warn!(round, "uploads of ended rounds stay on the disk, and are removed when the next round closes: {error}");
        }
        Ok(())
    }
}
