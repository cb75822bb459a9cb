//! What an audit says, for people and for machines.

pub mod describe;
pub mod history;
pub mod html;
pub mod svg;
pub mod verdict;
