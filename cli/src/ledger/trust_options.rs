//! The options for whom the user trusts.

use anyhow::Result;
use std::path::{Path, PathBuf};
use zk0_audit::log_source::{Trust, WrongUsage};
use zk0_circuits::Digest;
use zk0_ledger::witness_policy_file;

/// Whom to trust.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct TrustOptions {
    /// Accept only the ledger of the network with this id. Use it if you know the id from somebody whom you trust.
    #[arg(long, value_name = "ID")]
    pub network: Option<Digest>,
    /// Accept a checkpoint only if the witnesses that this file names have cosigned it (a C2SP tlog-policy). Without this option, the
    /// witnesses that the network's rules name must have cosigned it; only commands that read the whole log check that.
    #[arg(long, value_name = "FILE")]
    pub witness_policy: Option<PathBuf>,
    /// Where the log is read over HTTPS, accept only certificates that an authority in this PEM file has signed
    /// [default: the authorities that the system trusts]
    #[arg(long, value_name = "FILE")]
    pub ca: Option<PathBuf>,
}

impl TrustOptions {
    /// Reads the witness policy.
    pub fn read(&self) -> Result<Trust> {
        let read = |path: &Path| {
            let policy = witness_policy_file::read(path);
            policy.map_err(|error| WrongUsage(format!("--witness-policy {error}")))
        };
        Ok(Trust {
            network: self.network,
            witness_policy: self.witness_policy.as_deref().map(read).transpose()?,
            ca: self.ca.clone(),
        })
    }
}
