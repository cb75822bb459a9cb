//! TLS for all services.
//!
//! - [`authorities`]: whose certificates a client believes, and errors about others.
//! - [`service_address`] (feature `grpc`): a gRPC client connects to a service by its address.
//! - [`server_certificate`] (feature `server`): a server's certificate, which is read again while it runs.
//! - [`incoming`] (feature `server`): a server's connections, encrypted or not, one after the other and bounded.
//! - [`local_authority`] (feature `server`): signs certificates for tests and local networks.

pub mod authorities;
#[cfg(feature = "server")]
pub mod incoming;
#[cfg(feature = "server")]
pub mod local_authority;
#[cfg(feature = "server")]
pub mod server_certificate;
#[cfg(feature = "grpc")]
pub mod service_address;
