//! The options for a service's traces.

use anyhow::Result;
use std::path::PathBuf;
use zk0_service::traces::export::Traces;

/// Traces.
#[derive(Debug, clap::Args)]
pub struct OtlpOptions {
    /// Send traces to the OpenTelemetry collector at this address, such as http://127.0.0.1:4317 (OTLP over gRPC). With http:// nothing is
    /// encrypted. Off by default.
    #[arg(long, value_name = "ADDRESS")]
    otlp: Option<String>,
    /// Believe only a collector whose certificate is signed by one in this PEM file [default: the authorities that the system trusts]
    #[arg(long, value_name = "FILE")]
    otlp_ca: Option<PathBuf>,
}

impl OtlpOptions {
    /// The traces of `service`, if wanted.
    pub fn traces(&self, service: &'static str) -> Result<Option<Traces>> {
        let Some(address) = &self.otlp else {
            return Ok(None);
        };
        let collector = Traces::collector(address.clone()).with_ca(self.otlp_ca.clone());
        Ok(Some(Traces::to(collector, service)?))
    }
}
