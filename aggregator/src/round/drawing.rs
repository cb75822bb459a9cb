//! The closing of a round's commitments, and the randomness of its challenges. What has to be fetched over a network is fetched
//! elsewhere, so that the ledger goes on meanwhile: a beacon by [`crate::serve::beacon_fetching`], cosignatures by
//! [`crate::serve::service`].

use crate::round::aggregator::{Aggregator, StepOutcome};
use crate::round::awaited_beacon::AwaitedBeacon;
use crate::round::request_error::RequestError;
use zk0_protocol::challenge::closing::CommitmentsClosing;
use zk0_protocol::challenge::drand::DrandChain;
use zk0_protocol::challenge::drawing::{Cosignature, Drawing};
use zk0_protocol::challenge::source::RandomnessSource;
use zk0_protocol::entries::entry::{Body, RandomnessDrawn};
use zk0_protocol::rules::state::Round;

/// The checkpoint that has to be cosigned next.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ToCosign {
    /// How many entries it covers.
    pub size: u64,
    /// The checkpoint, with the log's signature.
    pub checkpoint: Vec<u8>,
    /// Whether the randomness of the open round follows from its cosignatures, so that each witness has to cosign it.
    pub draws: bool,
}

impl Aggregator {
    /// Takes the open round one step further, if it is time to.
    pub(super) fn step_in_round(&mut self, now: u64) -> Result<StepOutcome, RequestError> {
        let state = self.state();
        if let Some(round) = state.round().filter(|_| state.may_close(now)) {
            return Ok(StepOutcome::NeedsClosing(round.number()));
        }
        // Where no node may commit, the rules let a round end at once. The log would be full of such rounds.
        let empty =
            |round: &Round| round.commits.is_empty() && now <= round.opened.commit_deadline_ms;
        if state.round().is_some_and(empty) {
            return Ok(StepOutcome::Waiting);
        }
        if let Some(closed) = state.next_commitments_closed(now) {
            let round = closed.round;
            self.append_at(now, Body::CommitmentsClosed(closed))?;
            tracing::info!(round, "commitments closed");
            return Ok(StepOutcome::CommitmentsClosed(round));
        }
        let (Some(closing), Some(round)) = (state.to_draw(now), state.round()) else {
            return Ok(StepOutcome::Waiting);
        };
        let round = round.number();
        match &state.rules().randomness {
            RandomnessSource::LogVrf => {
                let proof = self.ledger.vrf(&closing.commitments);
                self.draw(round, Drawing::LogVrf(proof))?;
                Ok(StepOutcome::Drawn(round))
            }
            RandomnessSource::Drand(chain) => Ok(awaited(round, chain, closing, now)),
            RandomnessSource::Witnesses => Ok(StepOutcome::Waiting),
        }
    }

    /// Records the randomness of the open round.
    ///
    /// # Errors
    /// The randomness is not what the rules determine, or it comes too late.
    pub fn draw(&mut self, round: u64, drawing: Drawing) -> Result<(), RequestError> {
        let source = drawing.to_string();
        let drawn = RandomnessDrawn { round, drawing };
        self.append(Body::RandomnessDrawn(drawn))?;
        tracing::info!(round, %source, "randomness drawn");
        Ok(())
    }

    /// The checkpoint that witnesses have to cosign next. If the randomness of the open round follows from their cosignatures, this is
    /// the checkpoint that ends with the closing of its commitments, because a witness does not cosign an earlier checkpoint later.
    pub fn to_cosign(&self) -> Result<ToCosign, RequestError> {
        let state = self.state();
        let from_witnesses = state.rules().randomness == RandomnessSource::Witnesses;
        match state.to_draw(self.now_ms()).filter(|_| from_witnesses) {
            Some(closing) => {
                let size = closing.entry + 1;
                Ok(ToCosign {
                    size,
                    checkpoint: self.ledger.checkpoint_at(size)?,
                    draws: true,
                })
            }
            None => Ok(ToCosign {
                size: self.ledger.size(),
                checkpoint: self.ledger.checkpoint().to_vec(),
                draws: false,
            }),
        }
    }

    /// Records the randomness of the open round from the witnesses' cosignatures of its closing. If it came too late, the log says so,
    /// and the round closes without it.
    pub fn draw_cosigned(&mut self, cosignatures: Vec<Cosignature>) -> Result<(), RequestError> {
        let Some(round) = self.state().round().map(|round| round.number()) else {
            return Ok(());
        };
        match self.draw(round, Drawing::Witnesses(cosignatures)) {
            Err(RequestError::Violation(why)) => {
                tracing::warn!("{why}");
                Ok(())
            }
            done => done,
        }
    }
}

fn awaited(round: u64, chain: &DrandChain, closing: &CommitmentsClosing, now: u64) -> StepOutcome {
    let beacon = chain.round_after(closing.time_ms);
    if now >= chain.time_ms(beacon) {
        StepOutcome::NeedsBeacon(AwaitedBeacon {
            round,
            chain: chain.clone(),
            beacon,
        })
    } else {
        StepOutcome::Waiting
    }
}
