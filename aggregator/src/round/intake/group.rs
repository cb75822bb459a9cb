//! Records requests together: one write to disk and one signed checkpoint for all that wait ([`Ledger::commit`]).
//!
//! [`Ledger::commit`]: zk0_ledger::log::Ledger::commit

use crate::round::aggregator::Aggregator;
use crate::round::intake::submission::DecidedSubmission;
use crate::round::request_error::RequestError;
use zk0_ledger::error::LedgerError;
use zk0_ledger::group::WantedEntry;
use zk0_protocol::entries::authentic::AuthenticBody;
use zk0_verifier::decide::DecisionEntry;

/// What to record for a request.
pub enum ToRecord {
    /// A statement.
    Statement(Box<AuthenticBody>),
    /// The decision on a submission.
    Decision(Box<DecidedSubmission>),
}

impl Aggregator {
    /// Records all of this, each with its time of arrival. Returns the entry of each, or why there is none.
    pub fn record(&mut self, all: Vec<(u64, ToRecord)>) -> Vec<Result<u64, RequestError>> {
        let wanted = all.iter().map(|(time_ms, one)| WantedEntry {
            time_ms: *time_ms,
            body: one.body(),
        });
        let begin_ms = self.clock.now_ms();
        let outcomes = match self.ledger.commit(wanted.collect()) {
            Ok(outcomes) => outcomes,
            Err(error) => {
                let why = error.to_string();
                let failed = |_| match &error {
                    LedgerError::Clock(error) => Err(error.clone().into()),
                    _ => Err(RequestError::Internal(why.clone())),
                };
                return all.iter().map(failed).collect();
            }
        };
        let recorded = |(outcome, (_, one)): (Result<u64, _>, (u64, ToRecord))| {
            let index = outcome.map_err(RequestError::from)?;
            self.index.observe(index, &one.body());
            if let ToRecord::Decision(judged) = one {
                self.take(*judged);
            }
            Ok(index)
        };
        let recorded = outcomes.into_iter().zip(all).map(recorded).collect();
        self.after_recording(begin_ms);
        recorded
    }

    fn take(&mut self, judged: DecidedSubmission) {
        let terms = judged.submission().statement.claim.terms;
        let (node, round) = (terms.node, terms.round);
        match judged.decision() {
            DecisionEntry::Accepted(verified) => {
                tracing::info!(%node, round, "contribution accepted");
                self.contributions.push(*verified);
            }
            DecisionEntry::Rejected(reason) => {
                tracing::warn!(%node, round, %reason, "contribution rejected");
            }
        }
    }
}

impl ToRecord {
    pub(super) fn body(&self) -> AuthenticBody {
        match self {
            Self::Statement(body) => (**body).clone(),
            Self::Decision(decided) => decided.body(),
        }
    }
}
