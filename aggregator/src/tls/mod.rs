//! TLS for the servers: the certificate that they show ([`server_certificate`]), and an authority that signs one for tests and local
//! networks ([`local_authority`]).

pub mod local_authority;
pub mod server_certificate;
