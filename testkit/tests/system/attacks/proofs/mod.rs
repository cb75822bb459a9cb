//! Attacks on what a proof states.

pub mod guessed_point;
pub mod other_program;
pub mod wrapped_values;

use crate::attacks::attack::Outcome;
use zk0_testkit::cheats::try_cheat;

/// Has the code of the guest program, as it is in this build, judge the private input of a cheat. If it ends without an error, SP1 proves what it states:
/// that is the false claim.
pub fn guest(cheat: &str, what: &str) -> Outcome {
    match try_cheat(cheat) {
        Ok(()) => Outcome::Succeeded(format!(
            "the guest program states of {what} that it improves, and SP1 proves what it states"
        )),
        Err(reason) => Outcome::Refused(reason),
    }
}
