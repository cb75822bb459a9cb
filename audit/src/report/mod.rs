//! What an audit reports, for people and for machines.

mod charts;
pub mod describe;
pub mod history;
pub mod html;
mod page;
mod svg;
pub mod verdict;
