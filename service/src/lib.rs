//! What every service has.
//!
//! - [`tls`]: the certificate that a server shows, and whose certificates its clients believe.
//! - `traces` (feature `traces`): what took how long, for OpenTelemetry.
//! - `metrics` (feature `metrics`): metrics for Prometheus, and what is wrong with the service.
//!
//! Without features, there is only what a client with a blocking HTTP library needs, such as an auditor.

#[cfg(feature = "metrics")]
pub mod metrics;
pub mod tls;
#[cfg(feature = "traces")]
pub mod traces;
