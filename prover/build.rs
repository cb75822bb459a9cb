//! Generates the gRPC code of the federation's client and of the proving service.

fn main() -> std::io::Result<()> {
    tonic_prost_build::configure().compile_protos(&["../proto/federation.proto"], &["../proto"])
}
