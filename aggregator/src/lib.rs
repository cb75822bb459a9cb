//! The aggregator: the one writer of a ledger, the gRPC service in front of it, and what it publishes.
//!
//! A short tour:
//! - [`round`]: the rounds ([`round::aggregator`]), uploads that wait ([`round::staging`]), what a restarted aggregator reads from its
//!   ledger ([`round::ledger_index`]), disputes, the clock, and why a request is turned down ([`round::request`]).
//! - [`serve`]: the gRPC service, with its limits.
//! - [`publish`]: a small web server ([`publish::http`]), under which the log's files are served and a witness answers, and the
//!   client that asks witnesses for cosignatures ([`publish::cosigning`]).
//!
//! What decides about a submission and how a round ends are pure functions of [`zk0_verifier`].

pub mod publish;
pub mod round;
pub mod serve;

pub use crate::{
    round::{
        aggregator::{Aggregator, Config, Progress},
        clock::{Clock, ManualClock, SystemClock},
    },
    serve::service::{Limits, Service},
};
