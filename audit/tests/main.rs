//! What audits find, and what they say of it.

mod behind;
mod depths_and_threads;
mod dishonest_aggregator;
mod left_out;
mod programs;
mod pruning;
mod restoring;
mod results;
mod verdicts;
