//! TLS for all services.
//!
//! A short tour:
//! - [`authorities`]: whose certificates a client believes, and what it says of one that it does not believe.
//! - [`service_address`] (feature `grpc`): a gRPC client connects to a service by its address.
//! - [`server_certificate`] (feature `server`): the certificate that a server shows; it is read again while the server runs.
//! - [`incoming`] (feature `server`): the connections of a server that takes them one after the other, encrypted or not, and bounded.
//! - [`local_authority`] (feature `server`): an authority that signs a certificate for tests and local networks.
//!
//! Without features, there is only what a client with a blocking HTTP library wants. An auditor's build has nothing more.

pub mod authorities;
#[cfg(feature = "server")]
pub mod incoming;
#[cfg(feature = "server")]
pub mod local_authority;
#[cfg(feature = "server")]
pub mod server_certificate;
#[cfg(feature = "grpc")]
pub mod service_address;
