//! Every rule of the state machine has a test that fails without it.

#[path = "../network/mod.rs"]
mod network;

mod claims;
mod datasets;
mod disputes;
mod founding;
mod full_rounds;
mod members;
mod required_witnesses;
mod rounds;

use zk0_protocol::{Refusal, RuleViolation};

/// What is wrong, and a function that makes it so.
type Breaks<T> = (&'static str, fn(&mut T));

fn refused(violation: RuleViolation) -> Refusal {
    match violation {
        RuleViolation::Refused(refusal) => refusal,
        other => panic!("not a refusal: {other}"),
    }
}
