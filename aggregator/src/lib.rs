//! The aggregator: the one writer of a ledger, the gRPC service in front of it, and what it publishes.
//!
//! - [`round`]: founding a network ([`round::founding`]), opening and closing rounds ([`round::polling`], with [`round::phase`] and
//!   [`round::job`]), recording what nodes send ([`round::intake`]), waiting uploads ([`round::intake::staging`]), what a restart reads
//!   from the ledger ([`round::ledger_index`]), disputes ([`round::dispute`]), the clock, and why a request is turned down
//!   ([`round::request_error`]).
//! - [`serve`]: the gRPC service and its limits ([`serve::service`]), and its answers ([`serve::federation_service`]).
//! - [`publish`]: HTTP under limits ([`publish::http`]) for the log's files ([`publish::log_server`]) and for a witness
//!   ([`publish::witness_server`]), and clients of witnesses ([`publish::cosigning`]) and of servers of beacons ([`publish::beacon`]).
//! - [`connections`]: a bounded number of connections for both servers (their certificates are in `zk0_service::tls`); [`observe`]:
//!   metrics, status and trouble; `file_parts`: files sent in parts; `store_reads`: downloads of
//!   what is only in the blob store, as `growing_file`s; `line`: a bounded queue; `turns`: one turn at a time for each key;
//!   [`start_progress`]: how far a start is.
//!
//! The decision on a submission and the end of a round are pure functions of [`zk0_verifier`].

pub mod clock;
pub mod connections;
mod file_parts;
mod growing_file;
mod line;
pub mod observe;
pub mod publish;
pub mod round;
pub mod serve;
pub mod start_progress;
mod store_reads;
mod turns;

pub use crate::clock::{Clock, SystemClock};
pub use crate::connections::limits::ConnectionLimits;
pub use crate::round::aggregator::{Aggregator, Config};
pub use crate::round::job::{JobResult, Polled, RoundJob};
pub use crate::round::phase::RoundStep;
pub use crate::serve::limits::Limits;
pub use crate::serve::service::Service;
