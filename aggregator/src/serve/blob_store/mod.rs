//! Requests that wait for the store of the blobs. Without limits, a store that does not answer would hold all threads for the disk, and
//! block all else.
//!
//! - [`places`]: how many may wait; [`waiting`]: work in such a place; [`cache`]: keeps the ledger's folder small; [`sent`]: updates that
//!   nodes put into the store by themselves.

mod cache;
pub(super) mod places;
mod sent;
mod waiting;
