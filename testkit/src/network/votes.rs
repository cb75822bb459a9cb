//! Proposals, votes, and results.

use super::*;
use zk0_protocol::entries::entry::ProposalSettled;
use zk0_protocol::entries::proposal::{Action, Ballot, Outcome};
use zk0_protocol::entries::signed::{Proposal, Vote};

/// A node's enrolment.
pub fn enrolment(node: u8) -> NodeEnrolled {
    match enrolled(node) {
        Body::NodeEnrolled(enrolled) => enrolled,
        _ => unreachable!(),
    }
}

/// Of governor `by`.
pub fn proposal(state: &State, by: u8, action: Action) -> Proposal {
    Proposal {
        network: *state.network(),
        number: state.next_proposal(),
        proposer: governor(by),
        title: "a better network".into(),
        text: "because".into(),
        action,
    }
}

/// Signed by governor `by`.
pub fn proposed(state: &State, by: u8, action: Action) -> Body {
    Body::Proposed(Signed::new(proposal(state, by, action), &governor_key(by)))
}

/// Of this open proposal, or any.
pub fn digest_of(state: &State, proposal: u64) -> Digest {
    let open = state.proposals().get(&proposal);
    open.map(|open| open.digest).unwrap_or_default()
}

/// Signed by governor `by`.
pub fn voted(state: &State, by: u8, proposal: u64, ballot: Ballot) -> Body {
    let vote = Vote {
        network: *state.network(),
        proposal,
        of: digest_of(state, proposal),
        voter: governor(by),
        ballot,
    };
    Body::Voted(Signed::new(vote, &governor_key(by)))
}

/// Ends a proposal.
pub fn settled(proposal: u64, outcome: Outcome) -> Body {
    Body::ProposalSettled(ProposalSettled { proposal, outcome })
}

impl Chain {
    /// Moves the time.
    pub fn wait(&mut self, ms: u64) {
        self.time_ms += ms;
    }

    /// Proposes, votes for and executes `action`.
    pub fn decide(&mut self, action: Action) {
        let number = self.state.next_proposal();
        self.apply(proposed(&self.state, 0, action));
        for governor in 0..3 {
            self.apply(voted(&self.state, governor, number, Ballot::For));
        }
        self.wait(VOTING + TIME_LOCK);
        self.apply(settled(number, Outcome::Executed));
    }
}
