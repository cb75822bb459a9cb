//! Requests that wait for the store of the blobs. Without limits, a store that does not answer would hold all threads that read and write
//! the disk, and with them everything else.
//!
//! - [`places`]: how many may wait at once; [`waiting`]: work in such a place; [`cache`]: keeps the ledger's folder small; [`sent`]: updates that
//!   nodes put into the store by themselves.

mod cache;
pub(super) mod places;
mod sent;
mod waiting;
