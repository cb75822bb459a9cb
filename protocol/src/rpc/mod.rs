//! The gRPC messages of `proto/federation.proto` and `proto/health.proto`, generated once for clients and servers, their
//! conversions, and the signed heads of requests.

pub mod conversions;
pub mod head_metadata;
mod turned_down;

/// The number of the protocol that this release speaks. A change that an older node or aggregator would misread raises it.
pub const PROTOCOL: u32 = 1;

/// The generated messages, the client and the server.
#[allow(missing_docs, clippy::all)]
pub mod federation {
    tonic::include_proto!("zk0.v1");
}

/// The generated messages of health checks.
#[allow(missing_docs, clippy::all)]
pub mod health {
    tonic::include_proto!("grpc.health.v1");
}

/// Both services' encoded descriptors, for clients that request them.
pub const SERVICES: &[u8] = tonic::include_file_descriptor_set!("services");
