//! Every rule of the state machine has a test that fails without it.

mod challenges;
mod claims;
mod closings;
mod datasets;
mod disputes;
mod evaluation_sets;
mod faults;
mod founding;
mod full_rounds;
mod log_keys;
mod members;
mod presence;
mod required_witnesses;
mod rounds;
mod scaffold;
mod unanswered;

use zk0_protocol::{RefusalCode, RuleViolation};

/// What is wrong, and a function that makes it so.
type Breaks<T> = (&'static str, fn(&mut T));

fn refused(violation: RuleViolation) -> RefusalCode {
    match violation {
        RuleViolation::Refused(refusal) => refusal.code,
        other => panic!("not a refusal: {other}"),
    }
}
