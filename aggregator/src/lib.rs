//! The aggregator: the one writer of a ledger, the gRPC service in front of it, and what it publishes.
//!
//! A short tour:
//! - [`round`]: founding a network ([`round::founding`]), opening and closing rounds ([`round::polling`], with [`round::phase`] and [`round::job`]), recording what nodes send ([`round::intake`]), uploads that
//!   wait ([`round::intake::staging`]), what a restarted aggregator reads from its ledger ([`round::ledger_index`]), disputes
//!   ([`round::dispute`]), the clock, and why a request is turned down ([`round::request_error`]).
//! - [`serve`]: the gRPC service and its limits ([`serve::service`]), and the answers to its requests ([`serve::federation_service`]).
//! - [`publish`]: HTTP under limits ([`publish::http`]) for the log's files ([`publish::log_server`]) and for a witness
//!   ([`publish::witness_server`]), the client that asks witnesses for cosignatures ([`publish::cosigning`]), and the
//!   one that asks servers for beacons ([`publish::beacon`]).
//! - [`connections`]: a bounded number of connections for both servers, and who gets them; the crate `zk0-tls` has the certificate that they
//!   show; [`observe`]: metrics, status and trouble; `file_parts`: files sent in parts; `store_reads`: downloads of what is only in the blob store, as `growing_file`s; `line`: a bounded line of those who wait; `turns`: one turn at
//!   a time for each of them.
//!
//! The decision on a submission and the end of a round are pure functions of [`zk0_verifier`].

pub mod connections;
mod file_parts;
mod growing_file;
mod line;
pub mod observe;
pub mod publish;
pub mod round;
pub mod serve;
mod store_reads;
mod turns;

pub use crate::connections::limits::ConnectionLimits;
pub use crate::round::aggregator::{Aggregator, Config};
pub use crate::round::clock::{Clock, SystemClock};
pub use crate::round::job::{JobResult, Polled, RoundJob};
pub use crate::round::phase::RoundStep;
pub use crate::serve::limits::Limits;
pub use crate::serve::service::Service;
