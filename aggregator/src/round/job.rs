//! What the aggregator answers when it is polled, and the jobs that it leaves to others, because they take long or wait for a network.

use crate::publish::beacon::BeaconServers;
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
    /// Nothing is due before this time, in Unix milliseconds, unless something is recorded. `None` where nobody knows.
    Idle(Option<u64>),
    /// This step was recorded.
    Did(RoundStep),
    /// Somebody has to run this job, away from the aggregator, and give its result to [`Aggregator::finish`].
    ///
    /// [`Aggregator::finish`]: crate::round::aggregator::Aggregator::finish
    Run(RoundJob),
    /// Nothing goes on until a server of others answers. It is asked again after this time.
    Unanswered(String, Duration),
    /// The next round cannot open, or the open one cannot close, or a dispute cannot be decided, for this reason. What members send
    /// is still recorded.
    Blocked(String),
}

/// Work that nobody does while he has the aggregator.
#[derive(Clone, Debug, PartialEq)]
pub enum RoundJob {
    /// Read these blobs into the ledger's folder: the next round needs them, and they are only in the store.
    FetchBlobs(Blobs, Vec<Digest>),
    /// Check the public samples of the next round.
    CheckSamples(Box<UncheckedSamples>),
    /// Fetch the beacon that this open round waits for, from this chain, of this drand round. Its time has come.
    FetchBeacon(u64, Box<DrandChain>, u64),
    /// Compute the end of the open round.
    ComputeClosing(Box<ToClose>),
    /// Verify a disputed contribution again.
    VerifyAgain(Box<Disputed>),
}

/// What a job has come to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum JobResult {
    /// The blobs are in the folder.
    BlobsFetched,
    /// The samples hold what the next round needs.
    SamplesChecked(Box<UncheckedSamples>),
    /// The randomness of a round.
    Randomness(u64, Drawing),
    /// These files of accepted contributions are lost, so that the open round cannot close.
    FilesLost(Vec<ContributedFiles>),
    /// The end of the open round.
    Closing(Box<ComputedClosing>),
    /// What is wrong with the contribution that the dispute of this entry is about, if anything is.
    Verdict(u64, Option<Refusal>),
}

impl RoundJob {
    /// Does the work. If it cannot be done now, returns what the rounds wait for.
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
        })
    }

    /// The span of the job in traces, if it has one.
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
