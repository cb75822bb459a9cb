//! `zk0 ledger serve`: a ledger's files over HTTP.

use crate::blob_store::BlobStoreOptions;
use crate::certificate::CertificateOptions;
use crate::serve::serve_http;
use anyhow::Result;
use std::net::SocketAddr;
use std::path::PathBuf;
use zk0_aggregator::publish::http::HttpLimits;
use zk0_aggregator::publish::log_server::LogServer;
use zk0_ledger::published::publication::PublicationError;

/// `zk0 ledger serve`.
#[derive(Debug, clap::Args)]
pub struct LedgerServeOptions {
    /// The ledger's folder. Its aggregator may be running.
    dir: PathBuf,
    /// Listen on this address; port 0 takes a free port. Traffic is encrypted only with --tls-certificate.
    #[arg(long, default_value = "127.0.0.1:7073")]
    listen: SocketAddr,
    #[command(flatten)]
    store: BlobStoreOptions,
    /// With --blob-store: after a blob was read from the store, remove from the ledger's folder what was not read for longest, until its blobs
    /// have at most this many bytes. Leave this out while an aggregator uses the folder: it has such a limit itself [default: no limit]
    #[arg(long, value_name = "BYTES", requires = "blob_store")]
    blob_cache_bytes: Option<u64>,
    #[command(flatten)]
    certificate: CertificateOptions,
}

/// Runs the command.
pub fn serve(options: &LedgerServeOptions) -> Result<()> {
    let blobs = options.store.blobs_beside_writer(&options.dir)?;
    let mut server = LogServer::new(&options.dir).with_blobs(blobs);
    if let Some(bytes) = options.blob_cache_bytes {
        server = server.with_blob_cache(bytes);
    }
    match server.newest() {
        // A log is served once witnesses have cosigned it.
        Ok(_) | Err(PublicationError::NotCosigned(_)) => {}
        Err(error) => return Err(error.into()),
    }
    let limits = HttpLimits::default();
    let router = server.router(limits);
    let (listen, certificate) = (options.listen, &options.certificate);
    serve_http("log", listen, certificate, router, limits, || Ok(()))
}
