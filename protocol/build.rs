//! Generates the gRPC code of the federation, with the feature `rpc`.

fn main() -> std::io::Result<()> {
    #[cfg(feature = "rpc")]
    {
        println!("cargo::rerun-if-changed=../proto/federation.proto");
        tonic_prost_build::configure()
            .compile_protos(&["../proto/federation.proto"], &["../proto"])?;
    }
    Ok(())
}
