//! A log as it is published, and how others read and copy it.
//!
//! - [`publication`]: what a ledger's folder publishes now; [`tiles`]: its bytes from the database; [`export`]: all of it as plain files;
//!   [`export_place`]: where they are written.
//! - [`source`]: a folder or an address ([`web`]) with a published log; `web_file`: reads a file over HTTP to its end, although connections
//!   break; `patience`: when it gives up.
//! - [`reader`]: reads a published log and trusts none of its files; [`mirror`]: makes a ledger's folder of one;
//!   `mirror_error`: why it cannot; `held_entries`: what it knows of those that are there; `signer`: whether a former key has signed the log.
//! - [`http_client`]: sends requests.

pub mod export;
pub mod export_place;
mod held_entries;
pub mod http_client;
pub mod mirror;
mod mirror_error;
mod patience;
pub mod publication;
pub mod reader;
mod signer;
pub mod source;
pub mod tiles;
pub mod web;
mod web_file;
