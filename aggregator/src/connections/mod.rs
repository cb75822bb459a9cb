//! Bounded connections for the gRPC service and for the HTTP servers.
//!
//! - [`listening`]: where connections wait until they are accepted.
//! - [`limits`]: how many connections there may be, and how long they may idle.
//! - [`places`]: who holds a place; [`crowds`]: whose place a newcomer gets when all are taken.
//! - [`serving`]: accepts, closes and drains connections; [`windows`]: how many bytes may come before the service takes them.
//! - [`starting`]: what the port answers before the aggregator does.
//! - [`caller`]: who sends a request, by its signed head.
//! - [`request_limits`]: bounded requests, whose messages arrive in time and fit into the [`message_memory`]; [`message_body`]: the
//!   messages of one request; [`answer_body`]: the answer, until it is sent.
//! - [`transfers`]: how many files are sent and received at once; [`open_files`]: fits connections to the process' limit of open files.

pub(crate) mod answer_body;
pub(crate) mod caller;
mod crowds;
pub mod limits;
pub mod listening;
mod message_body;
pub(crate) mod message_memory;
pub mod open_files;
pub(crate) mod places;
pub(crate) mod request_limits;
pub(crate) mod serving;
pub mod starting;
pub(crate) mod transfers;
pub(crate) mod windows;
