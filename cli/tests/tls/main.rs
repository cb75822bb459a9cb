//! The network is encrypted, and nobody is believed who does not show the right certificate.

#[path = "../harness/mod.rs"]
mod harness;

mod binary;
mod certificates;
mod encrypted;
mod renewal;
