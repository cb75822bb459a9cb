//! Blobs, entries and published logs in a bucket.

mod cache;
mod entries;
mod failing_store;
mod kept_blobs;
mod public_log;
mod sent;
mod store_network;
