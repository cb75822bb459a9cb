//! Only a vote changes the rules, and the operator what the rules leave to it. Every way to cheat is refused, and every vote has the right outcome.

mod governors_keys;
mod operator;
mod programs;
mod proposals;
mod restoring;
mod strategies;
mod votes;

use zk0_protocol::entries::proposal::Action;
use zk0_protocol::Rules;
use zk0_testkit::network::genesis;

/// Returns rules with another number of samples per claim.
fn other_rules() -> Rules {
    Rules {
        min_eval_samples: 7,
        ..genesis().rules
    }
}

fn change() -> Action {
    Action::ChangeRules(Box::new(other_rules()))
}
