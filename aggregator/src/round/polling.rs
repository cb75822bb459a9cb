//! The rounds as a machine. A poll does what is due, or asks for a job. Jobs run away from the aggregator, and return results.

use crate::round::aggregator::{no_verifier, Aggregator};
use crate::round::closing::{ComputedClosing, ToClose};
use crate::round::dispute::Disputed;
use crate::round::job::{JobResult, Polled, RoundJob};
use crate::round::phase::{deadline_ms, due, Due, RoundStep};
use crate::round::request_error::RequestError;
use tracing::info_span;
use zk0_protocol::challenge::drawing::Drawing;
use zk0_protocol::challenge::source::RandomnessSource;
use zk0_protocol::entries::entry::{
    Body, DisputeResolved, MomentsComputed, ProposalSettled, RandomnessDrawn,
};
use zk0_protocol::entries::round_result::ResultOutcome;
use zk0_protocol::{Refusal, RefusalCode};
use zk0_verifier::combine::bases;
use zk0_verifier::combine::optimizers::moments;
use zk0_verifier::releases::can_verify;

/// The checkpoint that has to be cosigned next.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ToCosign {
    /// How many entries it covers.
    pub size: u64,
    /// The checkpoint, with the log's signature.
    pub checkpoint: Vec<u8>,
    /// The round whose randomness follows from its cosignatures, so that each witness has to cosign.
    pub draws: Option<u64>,
}

impl Aggregator {
    /// Takes the rounds a step further, if one is due at `now_ms`, in Unix milliseconds.
    pub fn poll(&mut self, now_ms: u64) -> Result<Polled, RequestError> {
        let now = self.ledger.time_ms(now_ms);
        if let Some(deadline_ms) = self.passed_deadline(now) {
            if self.arrivals.any_by(deadline_ms) {
                return Ok(Polled::Idle(None));
            }
        }
        let step = match due(self.state(), &self.config, now) {
            Due::Later(until_ms) => return Ok(Polled::Idle(until_ms)),
            Due::Now(step) if self.waits_for_witnesses(step, now) => return Ok(Polled::Idle(None)),
            Due::Now(step) => step,
        };
        match step {
            RoundStep::Settle(proposal) => {
                let outcome = self.state().outcome(proposal, now)?;
                if let Some(new) = self.new_witnesses(proposal, &outcome) {
                    return Ok(Polled::Run(RoundJob::AskWitnesses(Box::new(new))));
                }
                tracing::info!(proposal, %outcome, "proposal settled");
                let settled = ProposalSettled { proposal, outcome };
                self.append_at(now, Body::ProposalSettled(settled))?;
            }
            RoundStep::Resolve(_) => {
                let Some((dispute, open)) = self.state().undecided() else {
                    return Ok(Polled::Idle(None));
                };
                return Ok(
                    match Disputed::read(&self.ledger, &self.index, dispute, &open) {
                        Ok(disputed) => Polled::Run(RoundJob::VerifyAgain(Box::new(disputed))),
                        Err(error) => Polled::Blocked(format!(
                            "the dispute of entry {dispute} cannot be decided: {error}"
                        )),
                    },
                );
            }
            RoundStep::Open(round) => {
                if let Some(first) = self.before_opening() {
                    return Ok(first);
                }
                let opening = self.state().next_opening(now)?;
                self.append_at(now, Body::RoundOpened(opening))?;
                tracing::info!(round, "round opened");
            }
            RoundStep::CloseCommitments(round) => {
                let Some(closed) = self.state().next_commitments_closed(now) else {
                    return Ok(Polled::Idle(None));
                };
                self.append_at(now, Body::CommitmentsClosed(closed))?;
                tracing::info!(round, "commitments closed");
            }
            RoundStep::Draw(round) => {
                let state = self.state();
                let Some(closing) = state.to_draw(now) else {
                    return Ok(Polled::Idle(None));
                };
                match &state.rules().randomness {
                    RandomnessSource::LogVrf => {
                        let proof = self.ledger.vrf(&closing.commitments);
                        self.draw(round, Drawing::LogVrf(proof))?;
                    }
                    RandomnessSource::Drand(chain) => {
                        let beacon = chain.round_after(closing.time_ms);
                        let fetch = RoundJob::FetchBeacon(round, chain.clone(), beacon);
                        return Ok(Polled::Run(fetch));
                    }
                    RandomnessSource::Witnesses => return Ok(Polled::Idle(None)),
                }
            }
            // Its result may be a file that is being deleted.
            RoundStep::Close(_) if !self.doomed.is_empty() => return Ok(Polled::Idle(None)),
            RoundStep::Close(_) => {
                let to_close = ToClose {
                    state: self.state().clone(),
                    contributions: self.contributions.clone(),
                    lost: self.lost.clone(),
                    accepted: self.all_contributed(),
                    blobs: self.ledger.blobs().clone(),
                    dir: self.ledger.dir().into(),
                };
                return Ok(Polled::Run(RoundJob::ComputeClosing(Box::new(to_close))));
            }
        }
        Ok(Polled::Did(step))
    }

    /// Goes on with the result of a job.
    pub fn finish(&mut self, result: JobResult) -> Result<Polled, RequestError> {
        match result {
            JobResult::BlobsFetched => {}
            JobResult::WitnessesAsked(proposal) => self.asked_witnesses = Some(proposal),
            JobResult::SamplesChecked(samples) => self.checked_samples = Some(samples.rule()),
            JobResult::Randomness(round, drawing) => match self.draw(round, drawing) {
                Ok(()) => return Ok(Polled::Did(RoundStep::Draw(round))),
                // Too late: the round closes without it.
                Err(RequestError::Violation(why)) => {
                    tracing::warn!("{why}");
                    return Ok(Polled::Idle(None));
                }
                Err(error) => return Err(error),
            },
            JobResult::FilesLost(files) => {
                if let Some(why) = self.lose(&files)? {
                    return Ok(Polled::Blocked(why));
                }
            }
            JobResult::Closing(computed) => {
                let closed = info_span!("record").in_scope(|| self.close(*computed))?;
                if let Some(round) = closed {
                    return Ok(Polled::Did(RoundStep::Close(round)));
                }
            }
            JobResult::Verdict(dispute, upheld) => return self.resolve(dispute, upheld),
        }
        self.poll(self.arrivals.now_ms()?)
    }

    /// The open round's passed deadline at `now_ms` that the ledger does not reflect yet. What arrived after it waits for what arrived
    /// before.
    pub fn passed_deadline(&self, now_ms: u64) -> Option<u64> {
        deadline_ms(self.state()).filter(|deadline_ms| now_ms > *deadline_ms)
    }

    /// What the next round waits for; `None` if it may open now.
    fn before_opening(&mut self) -> Option<Polled> {
        if self.waits_for_more() {
            return Some(Polled::Idle(None));
        }
        let away = self.only_in_store();
        if !away.is_empty() {
            let blobs = self.ledger.blobs().clone();
            return Some(Polled::Run(RoundJob::FetchBlobs(blobs, away)));
        }
        if let Some(why) = self.blocked() {
            return Some(Polled::Blocked(why));
        }
        let samples = self.unchecked_samples()?;
        Some(Polled::Run(RoundJob::CheckSamples(Box::new(samples))))
    }

    fn waits_for_more(&mut self) -> bool {
        let state = self.ledger.state();
        let (round, least) = (state.next_round(), state.least_present());
        let present = self.presence.among(state.expected());
        if present >= least {
            self.absence = None;
            return false;
        }
        if self.absence.replace((present, least)) != Some((present, least)) {
            tracing::info!(
                round,
                present,
                least,
                "the round waits: {present} nodes are present that may contribute, and the rules ask for {least}"
            );
        }
        true
    }

    /// Why the next round cannot open here: unverifiable proofs, or missing base weights.
    fn blocked(&self) -> Option<String> {
        let state = self.state();
        let (round, blobs) = (state.next_round(), self.ledger.blobs());
        if !can_verify(state.program()) {
            return Some(format!("round {round} cannot open: {}", no_verifier(state)));
        }
        let base = ("it starts from the weights", state.global().blob, "");
        let earlier = bases::earlier(state).map(|earlier| {
            let reads = "its strategy reads the weights";
            (reads, earlier.blob, " that the round before started from")
        });
        let moments = moments::needed(state)
            .map(|moments| ("its strategy goes on from the moments", moments.blob, ""));
        let needs = [Some(base), earlier, moments];
        let (what, lost, which) =
            (needs.into_iter().flatten()).find(|(_, blob, _)| !blobs.contains(blob))?;
        Some(format!(
            "round {round} cannot open: {what} {lost}{which}, and that blob is not in the ledger's folder; put the file back as {}",
            blobs.path(&lost).display()
        ))
    }

    /// Records the open round's randomness, if the rules determine it so, and it is in time.
    fn draw(&mut self, round: u64, drawing: Drawing) -> Result<(), RequestError> {
        let source = drawing.to_string();
        let drawn = RandomnessDrawn { round, drawing };
        self.append(Body::RandomnessDrawn(drawn))?;
        tracing::info!(round, %source, "randomness drawn");
        Ok(())
    }

    /// Records the end of the open round, and returns its number. Computes the end again if a contributor has changed its key. If the clock
    /// was set back to before a submission deadline, the round waits: what still comes in time counts, and the end is computed again, too.
    fn close(&mut self, computed: ComputedClosing) -> Result<Option<u64>, RequestError> {
        let ComputedClosing {
            closing,
            contributors,
        } = computed;
        let mut closed = closing.closed;
        let round = closed.round;
        // All of the end is judged by one time.
        let now = self.now_ms();
        let state = self.state();
        let open = state.round().filter(|open| open.number() == round);
        let Some(open) = open.filter(|_| state.contributors() == contributors) else {
            return Ok(None);
        };
        if !state.may_close(now) {
            return Ok(None);
        }
        // What came too late was answered, too.
        closed.unanswered = state.unanswered();
        let outcome = closed.evaluated.as_ref().map(|one| one.outcome);
        // Recorded already if the aggregator was killed between the two entries.
        let named = open.moments;
        if let Some(moments) = closing.moments.filter(|moments| named != Some(*moments)) {
            let computed = MomentsComputed { round, moments };
            self.append_at(now, Body::MomentsComputed(computed))?;
        }
        self.append_at(now, Body::RoundClosed(closed))?;
        self.contributions.clear();
        self.lost.clear();
        tracing::info!(round, contributors = contributors.len(), "round closed");
        match outcome {
            Some(ResultOutcome::Taken) | None => {}
            Some(outcome) => tracing::warn!(round, "{outcome}"),
        }
        Ok(Some(round))
    }

    fn resolve(&mut self, dispute: u64, upheld: Option<Refusal>) -> Result<Polled, RequestError> {
        match &upheld {
            Some(unchecked) if unchecked.code == RefusalCode::NoVerifier => {
                return Ok(Polled::Blocked(format!(
                    "the dispute of entry {dispute} cannot be decided by this release of zk0: {unchecked}"
                )))
            }
            Some(reason) => tracing::warn!(dispute, %reason, "dispute upheld"),
            None => tracing::info!(dispute, "dispute dismissed: the contribution verifies"),
        }
        let upheld = upheld.map(|reason| reason.code);
        self.append(Body::DisputeResolved(DisputeResolved { dispute, upheld }))?;
        Ok(Polled::Did(RoundStep::Resolve(dispute)))
    }

    /// The checkpoint that witnesses have to cosign next. If the open round's randomness follows from their cosignatures, it ends with the
    /// closing of the commitments, because a witness does not cosign an earlier checkpoint later.
    pub fn to_cosign(&self) -> Result<ToCosign, RequestError> {
        let state = self.state();
        let from_witnesses = state.rules().randomness == RandomnessSource::Witnesses;
        // A witness that has cosigned a later checkpoint does not cosign this one.
        let may_come = |entry| {
            self.published
                .is_none_or(|published| published <= entry + 1)
        };
        let closing = state.to_draw(self.now_ms());
        let closing = closing.filter(|closing| from_witnesses && may_come(closing.entry));
        match (closing, state.round()) {
            (Some(closing), Some(round)) => {
                let size = closing.entry + 1;
                Ok(ToCosign {
                    size,
                    checkpoint: self.ledger.checkpoint_at(size)?,
                    draws: Some(round.number()),
                })
            }
            _ => Ok(ToCosign {
                size: self.ledger.size(),
                checkpoint: self.ledger.checkpoint().to_vec(),
                draws: None,
            }),
        }
    }
}
