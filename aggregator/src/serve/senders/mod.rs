//! Who sends a request.

pub mod replay_window;
pub mod sender;
