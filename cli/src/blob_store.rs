//! Options for a ledger's blobs, which may be in a store.

use anyhow::Result;
use std::env;
use std::path::Path;
use std::time::Duration;
use zk0_ledger::blobs::Blobs;
use zk0_ledger::bucket::public_log::PublicLog;
use zk0_ledger::bucket::waiting::RetryPeriod;
use zk0_ledger::bucket::Bucket;

/// Where the blobs are kept.
#[derive(Debug, clap::Args)]
pub struct BlobStoreOptions {
    /// The ledger's entries, weights and proofs are kept in the store at this address, too: s3://BUCKET/PREFIX, gs://BUCKET/PREFIX, az://CONTAINER/PREFIX
    /// or file:///FOLDER. The ledger's folder then is a cache of it. Credentials are in the variables AWS_…, GOOGLE_… or AZURE_… of the
    /// environment. The store belongs to one network, and must not be public. Give each command about this ledger the same address
    /// [default: the ledger's folder alone]
    #[arg(long, value_name = "ADDRESS")]
    blob_store: Option<String>,
    /// When the blob store fails, try again for this many seconds.
    #[arg(
        long,
        value_name = "SECONDS",
        default_value_t = 60,
        value_parser = clap::value_parser!(u64).range(1..=600)
    )]
    blob_store_seconds: u64,
}

impl BlobStoreOptions {
    /// The blobs of the ledger in `dir`.
    ///
    /// # Errors
    /// The address or the credentials are wrong, the store does not answer, or it belongs to another network.
    pub fn blobs(&self, dir: &Path) -> Result<Blobs> {
        let blobs = match self.bucket()? {
            None => Blobs::at(dir),
            Some(bucket) => Blobs::in_store(dir, Box::new(bucket))?,
        };
        blobs.check_network()?;
        Ok(blobs)
    }

    /// As [`Self::blobs`], for a reader beside a running aggregator.
    ///
    /// # Errors
    /// Those of [`Self::blobs`].
    pub fn blobs_beside_writer(&self, dir: &Path) -> Result<Blobs> {
        let blobs = match self.bucket()? {
            None => Blobs::at(dir),
            Some(bucket) => Blobs::beside_writer(dir, Box::new(bucket))?,
        };
        blobs.check_network()?;
        Ok(blobs)
    }

    fn bucket(&self) -> Result<Option<Bucket>> {
        let Some(address) = &self.blob_store else {
            return Ok(None);
        };
        Ok(Some(Bucket::open(address, &variables(), self.patience())?))
    }

    /// A published log in the store at `address`.
    ///
    /// # Errors
    /// Those of [`Self::blobs`].
    pub fn public_log(&self, address: &str) -> Result<PublicLog> {
        Ok(PublicLog::open(address, &variables(), self.patience())?)
    }

    fn patience(&self) -> RetryPeriod {
        RetryPeriod(Duration::from_secs(self.blob_store_seconds))
    }
}

/// Without names and values that are not text.
fn variables() -> Vec<(String, String)> {
    env::vars_os()
        .filter_map(|(name, value)| Some((name.into_string().ok()?, value.into_string().ok()?)))
        .collect()
}
