//! A log as it is published, and how others read and copy it.
//!
//! - [`publication`]: what a ledger's folder publishes at this moment; [`tiles`]: its bytes from the database; [`export`]: all of
//!   it as plain files; [`place`]: where these are written.
//! - [`source`]: where a published log is read from: a folder, or an address ([`web`]). `web_file` reads a file over HTTP to its end, although
//!   connections break, and `patience` says when it gives up.
//! - [`reader`]: a reader of such a log, who trusts none of its files; [`mirror`]: a ledger's folder made from one.
//! - [`http_client`]: asks servers of logs, and others.

pub mod export;
pub mod export_place;
pub mod http_client;
pub mod mirror;
mod patience;
pub mod publication;
pub mod reader;
pub mod source;
pub mod tiles;
pub mod web;
mod web_file;
