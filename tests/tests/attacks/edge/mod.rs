//! Attacks by whoever can send bytes to the service, or read and change those of others on their way.

pub mod silent_uploads;
pub mod stolen_statement;
