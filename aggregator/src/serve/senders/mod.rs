//! Who sends a request.

pub mod heads;
mod replay_window;
pub mod sender;
