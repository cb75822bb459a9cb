//! The phases of the rounds, and what is due in them: pure functions of the ledger's state and the time.

use crate::round::aggregator::Config;
use zk0_protocol::challenge::source::RandomnessSource;
use zk0_protocol::entries::member::Standing;
use zk0_protocol::rpc::federation::status_info::Phase;
use zk0_protocol::rules::state::State;

/// A step of the rounds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RoundStep {
    /// Settle this proposal.
    Settle(u64),
    /// Decide the dispute that this entry raised.
    Resolve(u64),
    /// Open this round.
    Open(u64),
    /// Close the commitments of this round.
    CloseCommitments(u64),
    /// Draw the randomness of this round.
    Draw(u64),
    /// Close this round.
    Close(u64),
}

/// What is due.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Due {
    /// This step, now.
    Now(RoundStep),
    /// Not before this time, in Unix milliseconds, unless something is recorded. `None` if the ledger does not determine it.
    Later(Option<u64>),
}

/// The phase that the rounds are in.
pub fn phase(state: &State, now_ms: u64) -> Phase {
    match state.round() {
        None => Phase::Waiting,
        Some(_) if state.may_close(now_ms) => Phase::Closing,
        Some(round) => match (&round.closing, &round.randomness) {
            (None, _) => Phase::Committing,
            (Some(_), None) => Phase::Drawing,
            (Some(_), Some(_)) => Phase::Submitting,
        },
    }
}

/// The open round's deadline, for commitments or for submissions.
pub fn deadline_ms(state: &State) -> Option<u64> {
    let round = state.round()?;
    match (&round.closing, &round.randomness) {
        (None, _) => Some(round.opened.commit_deadline_ms),
        (Some(_), None) => None,
        (Some(_), Some(randomness)) => Some(randomness.submit_deadline_ms),
    }
}

/// A round closes after its windows end: its result is computed, and lost files are requested. That may take this long or a submission
/// window.
const CLOSING_MS: u64 = 60_000;

/// Whether the open round should have closed long ago.
pub fn is_overdue(state: &State, now_ms: u64) -> bool {
    let (Some(round), rules) = (state.round(), state.rules()) else {
        return false;
    };
    let after_closing = rules
        .randomness_window_ms
        .saturating_add(rules.submit_window_ms);
    let ends_ms = match (&round.closing, &round.randomness) {
        (None, _) => round
            .opened
            .commit_deadline_ms
            .saturating_add(after_closing),
        (Some(closing), None) => closing
            .time_ms
            .saturating_add(round.moved_ms)
            .saturating_add(after_closing),
        (Some(_), Some(randomness)) => randomness.submit_deadline_ms,
    };
    now_ms > ends_ms.saturating_add(rules.submit_window_ms.max(CLOSING_MS))
}

/// How many active nodes have a dataset.
pub fn ready(state: &State) -> usize {
    let nodes = state.nodes().values();
    let ready = nodes.filter(|node| node.dataset.is_some() && node.standing == Standing::Active);
    ready.count()
}

/// What is due at `now_ms`.
pub fn due(state: &State, config: &Config, now_ms: u64) -> Due {
    let Some(round) = state.round() else {
        return between_rounds(state, config, now_ms);
    };
    let number = round.number();
    let deadline = Due::Later(deadline_ms(state).map(|last_ms| last_ms.saturating_add(1)));
    match phase(state, now_ms) {
        Phase::Closing => Due::Now(RoundStep::Close(number)),
        Phase::Committing => {
            // The rules let a round without commitments end at once. Such rounds would fill the log.
            let empty = round.commits.is_empty() && now_ms <= round.opened.commit_deadline_ms;
            if empty || state.next_commitments_closed(now_ms).is_none() {
                deadline
            } else {
                Due::Now(RoundStep::CloseCommitments(number))
            }
        }
        Phase::Drawing => match (&state.rules().randomness, state.to_draw(now_ms)) {
            (RandomnessSource::LogVrf, Some(_)) if state.has_drawing_key() => {
                Due::Now(RoundStep::Draw(number))
            }
            (RandomnessSource::Drand(chain), Some(closing)) => {
                let begins_ms = chain.time_ms(chain.round_after(closing.time_ms));
                if now_ms >= begins_ms {
                    Due::Now(RoundStep::Draw(number))
                } else {
                    Due::Later(Some(begins_ms))
                }
            }
            (RandomnessSource::LogVrf | RandomnessSource::Witnesses, _) | (_, None) => {
                Due::Later(None)
            }
        },
        Phase::Submitting | Phase::Waiting | Phase::Unspecified => deadline,
    }
}

fn between_rounds(state: &State, config: &Config, now_ms: u64) -> Due {
    let number = state.next_round();
    if let Some(proposal) = state.due(now_ms) {
        return Due::Now(RoundStep::Settle(proposal));
    }
    if let Some((dispute, _)) = state.undecided() {
        return Due::Now(RoundStep::Resolve(dispute));
    }
    let done = config.rounds.is_some_and(|rounds| number >= rounds);
    let least = config.min_nodes;
    // A pause is counted in rounds, so a network whose nodes all pause goes on.
    let some = state.expected().chain(state.pausing()).next().is_some();
    if done || ready(state) < least || (least > 0 && !some) {
        Due::Later(None)
    } else {
        Due::Now(RoundStep::Open(number))
    }
}
