//! Attacks by whoever can send bytes to the service, or read and change those of others on their way.

pub mod busy_crowd;
pub mod changed_statement;
mod crowds;
pub mod idle_crowd;
pub mod impostor;
pub mod silent_uploads;
pub mod stolen_request;
