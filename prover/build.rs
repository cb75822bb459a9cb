//! Generates the gRPC code of the proving service and of the federation.

fn main() -> std::io::Result<()> {
    tonic_prost_build::configure().compile_protos(
        &["../proto/prover.proto", "../proto/federation.proto"],
        &["../proto"],
    )
}
