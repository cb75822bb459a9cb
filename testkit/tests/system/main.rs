//! Tests of the whole system. The tests of one crate are in that crate; those of the binary are in `cli/tests`.
//!
//! - `attacks`: one attack for each row of the table of attacks, which is refused, and succeeds where its defence is taken out.
//! - `among_strangers`, `cut_transfers`, `service_faults`: real nodes, and connections that others hold, that are cut, or that end in nothing.
//! - `verifier_attacks`: a contribution with a real proof, in which one thing at a time is changed.
//! - `averages`: the result of a real round, and another one in its place.
//! - `denials`: an operator denies that a contribution with a real proof verifies.
//! - `ledger_tampering`: the replay of a real ledger, in which one byte at a time is changed.
//!
//! The last four work on the [`real_ledger`]. `alone` has what needs a process of its own.

mod among_strangers;
mod attacks;
mod averages;
mod cut_transfers;
mod denials;
mod ledger_tampering;
mod real_ledger;
mod service_faults;
mod verifier_attacks;
