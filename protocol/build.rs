//! Generates the gRPC code of the federation and of health checks, with the feature `rpc`.

fn main() -> std::io::Result<()> {
    #[cfg(feature = "rpc")]
    {
        let protos = ["../proto/federation.proto", "../proto/health.proto"];
        for proto in protos {
            println!("cargo::rerun-if-changed={proto}");
        }
        let out = std::env::var("OUT_DIR").map_err(std::io::Error::other)?;
        tonic_prost_build::configure()
            .file_descriptor_set_path(std::path::Path::new(&out).join("services.bin"))
            .compile_protos(&protos, &["../proto"])?;
    }
    Ok(())
}
