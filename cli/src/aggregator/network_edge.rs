//! Options of `zk0 aggregator serve` for its connections.

use crate::certificate::CertificateOptions;
use anyhow::Result;
use std::sync::Arc;
use std::time::Duration;
use zk0_aggregator::connections::open_files;
use zk0_aggregator::publish::http;
use zk0_aggregator::{ConnectionLimits, Limits};
use zk0_service::tls::server_certificate::ServerCertificate;

/// A year in seconds. Clocks cannot show much longer times.
const LONGEST_IDLE: u64 = 31_536_000;

/// The edge to the network.
#[derive(Debug, clap::Args)]
pub struct NetworkEdge {
    /// The certificate, which is also for the log's files.
    #[command(flatten)]
    certificate: CertificateOptions,
    /// Have at most this many connections. If more come, one makes room whose network has most of them.
    #[arg(long, value_name = "N", default_value_t = ConnectionLimits::default().most as u32, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    max_connections: u32,
    /// Close a connection on which there was no request for so long.
    #[arg(long, value_name = "SECONDS", default_value_t = ConnectionLimits::default().idle.as_secs(), value_parser = clap::value_parser!(u64).range(1..=LONGEST_IDLE))]
    idle_seconds: u64,
    /// Use at most this much memory for messages over 32 KiB that are received and answered. Half of it is for nodes.
    #[arg(long, value_name = "MIB", default_value_t = Limits::default().message_memory >> 20, value_parser = clap::value_parser!(u64).range(1..=1 << 20))]
    message_memory_mib: u64,
    /// Refuse a request if the clock of its sender and the aggregator's differ by more than this. Requests that are on their way for longer are
    /// refused, too.
    #[arg(long, value_name = "SECONDS", default_value_t = Limits::default().skew.as_secs(), value_parser = clap::value_parser!(u64).range(1..=3600))]
    clock_skew_seconds: u64,
    /// At the end, take at most so long to answer the requests that are in progress.
    #[arg(long, value_name = "SECONDS", default_value_t = ConnectionLimits::default().drain.as_secs(), value_parser = clap::value_parser!(u64).range(..=86_400))]
    drain_seconds: u64,
}

impl NetworkEdge {
    /// The certificate, if connections are encrypted.
    pub fn certificate(&self) -> Result<Option<Arc<ServerCertificate>>> {
        self.certificate.load()
    }

    /// Limits of the aggregator and of the log's file server. The system must allow as many open files.
    pub fn limits(&self, serves_log: bool) -> (Limits, http::HttpLimits) {
        let mut log = http::HttpLimits::default();
        let mut connections = ConnectionLimits {
            most: self.max_connections as usize,
            idle: Duration::from_secs(self.idle_seconds),
            drain: Duration::from_secs(self.drain_seconds),
            ..ConnectionLimits::default()
        };
        log.connections.drain = connections.drain;
        let most = if serves_log { log.connections.most } else { 0 };
        open_files::fit(&mut connections, most);
        let limits = Limits {
            connections,
            message_memory: self.message_memory_mib << 20,
            skew: Duration::from_secs(self.clock_skew_seconds),
            ..Limits::default()
        };
        (limits, log)
    }
}
