//! Connections between nodes and an aggregator, and to the other services: they are encrypted, nobody is believed who does not show the right certificate, and a node
//! connects again when its connection is lost.

mod binary;
mod certificates;
mod encrypted;
mod lost_connection;
mod renewal;
mod services;
