//! What the aggregator does, as nodes, operators, witnesses and strangers see it.

mod absent_witnesses;
mod blob_store;
mod connections;
mod cosigned_checkpoint;
mod kept_state;
mod observed;
mod phases;
mod pruning;
mod senders;
mod served;
mod transfers;

type Test = Result<(), Box<dyn std::error::Error>>;
