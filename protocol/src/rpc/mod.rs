//! The gRPC messages of `proto/federation.proto`, generated once for clients and servers, and their conversions.

pub mod conversions;

/// The generated messages, the client and the server.
#[allow(missing_docs, clippy::all)]
pub mod federation {
    tonic::include_proto!("zk0.v1");
}
