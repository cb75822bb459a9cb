//! What the aggregator answers when polled, and the jobs that it leaves to others, because they take long or wait.

use crate::publish::beacon::BeaconServers;
use crate::publish::new_witnesses::NewWitnesses;
use crate::round::closing::{ComputedClosing, ToClose};
use crate::round::dispute::Disputed;
use crate::round::intake::lost_files::ContributedFiles;
use crate::round::phase::RoundStep;
use crate::round::public_samples::UncheckedSamples;
use crate::round::request_error::RequestError;
use std::time::Duration;
use tracing::{info_span, Span};
use zk0_circuits::Digest;
use zk0_ledger::blobs::Blobs;
use zk0_protocol::challenge::drand::DrandChain;
use zk0_protocol::challenge::drawing::Drawing;
use zk0_protocol::rules::state::Round;
use zk0_protocol::Refusal;

/// What [`Aggregator::poll`] answers.
///
/// [`Aggregator::poll`]: crate::round::aggregator::Aggregator::poll
#[derive(Clone, Debug, PartialEq)]
pub enum Polled {
    /// Nothing is due before this time, in Unix milliseconds, unless something is recorded. `None` if unknown.
    Idle(Option<u64>),
    /// This step was recorded.
    Did(RoundStep),
    /// This job has to run away from the aggregator, and its result goes to [`Aggregator::finish`].
    ///
    /// [`Aggregator::finish`]: crate::round::aggregator::Aggregator::finish
    Run(RoundJob),
    /// An outside server has to answer. It is asked again after this time.
    Unanswered(String, Duration),
    /// Why a round cannot open or close, or a dispute cannot be decided. Members' messages are still recorded.
    Blocked(String),
}

/// Work that must not hold the aggregator.
#[derive(Clone, Debug, PartialEq)]
pub enum RoundJob {
    /// Read these blobs for the next round into the ledger's folder.
    FetchBlobs(Blobs, Vec<Digest>),
    /// Check the public samples of the next round.
    CheckSamples(Box<UncheckedSamples>),
    /// Fetch this open round's beacon, from this chain, of this drand round, which is due.
    FetchBeacon(u64, Box<DrandChain>, u64),
    /// Compute the end of the open round.
    ComputeClosing(Box<ToClose>),
    /// Verify a disputed contribution again.
    VerifyAgain(Box<Disputed>),
    /// Ask the witnesses that a proposal names, before it is settled.
    AskWitnesses(Box<NewWitnesses>),
}

/// The result of a job.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum JobResult {
    /// The blobs are in the folder.
    BlobsFetched,
    /// The samples hold what the next round needs.
    SamplesChecked(Box<UncheckedSamples>),
    /// The randomness of a round.
    Randomness(u64, Drawing),
    /// The round cannot close without these files of accepted contributions.
    FilesLost(Vec<ContributedFiles>),
    /// The end of the open round.
    Closing(Box<ComputedClosing>),
    /// What is wrong with the contribution that this entry disputes, if anything.
    Verdict(u64, Option<Refusal>),
    /// The witnesses that this proposal names were asked.
    WitnessesAsked(u64),
}

impl RoundJob {
    /// Does the work. If that is not possible now, returns what the rounds wait for.
    pub fn run(self, beacons: &BeaconServers) -> Result<Result<JobResult, Polled>, RequestError> {
        Ok(match self {
            Self::FetchBlobs(blobs, needed) => {
                let fetched = needed.iter().try_for_each(|blob| blobs.fetch(blob));
                let fetched = fetched.map_err(RequestError::from);
                fetched.map(|()| JobResult::BlobsFetched).map_err(|error| {
                    Polled::Blocked(format!("the next round cannot open: {error}"))
                })
            }
            Self::CheckSamples(samples) => {
                let checked = samples.check().map_err(Polled::Blocked);
                checked.map(|()| JobResult::SamplesChecked(samples))
            }
            Self::FetchBeacon(of, chain, round) => match beacons.fetch(&chain, round) {
                Ok(signature) => Ok(JobResult::Randomness(
                    of,
                    Drawing::Drand { round, signature },
                )),
                Err(error) => {
                    let why = format!("round {of} waits for its randomness: {error}");
                    Err(Polled::Unanswered(why, beacons.retry()))
                }
            },
            Self::ComputeClosing(to_close) => {
                let lost = to_close.lost_files();
                if !lost.is_empty() {
                    return Ok(Ok(JobResult::FilesLost(lost)));
                }
                let computed = to_close.compute()?.map_err(Polled::Blocked);
                computed.map(|computed| JobResult::Closing(Box::new(computed)))
            }
            Self::VerifyAgain(disputed) => {
                let (entry, verdict) = (disputed.dispute, disputed.verify_again());
                let verdict = verdict.map(|upheld| JobResult::Verdict(entry, upheld));
                verdict.map_err(|error| {
                    let why = format!("the dispute of entry {entry} cannot be decided: {error}");
                    Polled::Blocked(why)
                })
            }
            Self::AskWitnesses(new) => {
                new.ask();
                Ok(JobResult::WitnessesAsked(new.proposal))
            }
        })
    }

    /// The job's span in traces, if it has one.
    pub fn span(&self) -> Span {
        match self {
            Self::ComputeClosing(to_close) => {
                let round = to_close.state.round().map(Round::number);
                info_span!("close the round", zk0.round = round)
            }
            _ => Span::none(),
        }
    }
}
