//! Generates the gRPC code of the proving service.

fn main() -> std::io::Result<()> {
    println!("cargo::rerun-if-changed=../proto/prover.proto");
    tonic_prost_build::configure().compile_protos(&["../proto/prover.proto"], &["../proto"])
}
