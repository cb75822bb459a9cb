//! What audits find, and what they state of it.

mod behind;
mod depths_and_threads;
mod dishonest_aggregator;
mod keys;
mod left_out;
mod present_key;
mod programs;
mod pruning;
mod restoring;
mod results;
mod verdicts;
