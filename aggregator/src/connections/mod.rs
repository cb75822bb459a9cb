//! Connections that nobody can exhaust, for the gRPC service and for the HTTP servers.
//!
//! - [`listening`]: where connections come, and wait until they are taken.
//! - [`limits`]: how many connections there may be, and how long they may last without a request.
//! - [`places`]: who holds a place. One place goes to whoever comes while all are taken; [`crowds`]: which one.
//! - [`serving`]: accepts connections, closes those that are late or idle, and drains them at the end; [`windows`]: how many bytes of one may
//!   come before the service takes them.
//! - [`caller`]: who sends a request, by its signed head.
//! - [`request_limits`]: a bounded number of requests, whose messages arrive in time and fit into the [`message_memory`];
//!   [`message_body`]: the messages of one request; [`answer_body`]: the answer, until it is sent.
//! - [`transfers`]: how many files are sent and received at once; [`open_files`]: as many connections and transfers as the process may have
//!   open files for.

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
pub(crate) mod transfers;
pub(crate) mod windows;
