fn main() -> std::io::Result<()> {
    #[cfg(feature = "service")]
    {
        println!("cargo::rerun-if-changed=../proto/federation.proto");
        tonic_prost_build::configure()
            .compile_protos(&["../proto/federation.proto"], &["../proto"])?;
    }
    Ok(())
}
