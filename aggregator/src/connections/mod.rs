//! Connections that nobody can exhaust, for the gRPC service and for the HTTP servers.
//!
//! - [`listening`]: where connections come, and wait until they are taken.
//! - [`limits`]: how many connections there may be, and how long they may last without a request.
//! - [`places`]: who holds a place. A connection is a stranger's until a node has shown on it who it is. A stranger's place goes to
//!   whoever comes while all are taken; a node keeps its place. [`crowds`]: which stranger makes room.
//! - [`caller`]: the connection that a request came on, as its handler sees it; a handler names the [`caller::Author`] of a request.
//! - [`serving`]: accepts connections, closes those that are late or idle, and drains them at the end; [`stream`]: the bytes of one;
//!   [`windows`]: how many of them may come before the service takes them.
//! - [`requests`]: a bounded number of requests, whose messages arrive in time and fit into the [`message_memory`];
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
mod stream;
pub(crate) mod transfers;
pub(crate) mod windows;
