//! Where a command finds blobs to read.

#[cfg(feature = "full")]
use crate::blob_store::BlobStoreOptions;
use anyhow::Result;
use std::path::Path;
use zk0_ledger::Blobs;

/// Where the blobs are kept that a command reads. An auditor's light build knows the ledger's folder alone.
#[derive(Debug, clap::Args)]
pub struct KeptBlobsOptions {
    #[cfg(feature = "full")]
    #[command(flatten)]
    store: BlobStoreOptions,
}

impl KeptBlobsOptions {
    /// The blobs of the ledger in `dir`, whose aggregator may be running.
    ///
    /// # Errors
    /// Those of `BlobStoreOptions::blobs`.
    #[cfg(feature = "full")]
    pub fn blobs(&self, dir: &Path) -> Result<Blobs> {
        self.store.blobs_beside_writer(dir)
    }

    /// The blobs in the folder `dir`.
    #[cfg(not(feature = "full"))]
    pub fn blobs(&self, dir: &Path) -> Result<Blobs> {
        Ok(Blobs::at(dir))
    }
}
