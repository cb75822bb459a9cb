//! Finds logs by their address or folder, and says whose signatures an auditor trusts.

use anyhow::{bail, Result};
use std::path::{Path, PathBuf};
use zk0_circuits::Digest;
use zk0_ledger::folder;
use zk0_ledger::published::publication::Publication;
use zk0_ledger::published::reader::{first_entry, PublishedLog};
use zk0_ledger::published::source::{Folder, Source};
use zk0_ledger::published::web::Web;
use zk0_protocol::{Body, Entry, Genesis, VerifierKey, WitnessPolicy};

/// Whom an auditor trusts.
#[derive(Clone, Debug, Default)]
pub struct Trust {
    /// The network that the log has to be of; `None` if the auditor does not know its id.
    pub network: Option<Digest>,
    /// The witnesses whose cosignatures have to be on the checkpoint. `None` asks for those that the network's rules name, where the
    /// whole log is read.
    pub witness_policy: Option<WitnessPolicy>,
    /// The PEM file with the authorities that count where a log is read over HTTPS; by default those that the system trusts.
    pub ca: Option<PathBuf>,
}

/// Finds a log by its address or folder. `ca` is as in [`Trust::ca`].
pub fn source(text: &str, ca: Option<&Path>) -> Result<Box<dyn Source>> {
    if text.starts_with("http://") || text.starts_with("https://") {
        return Ok(Box::new(Web::at(text, ca)?));
    }
    let dir = Path::new(text);
    if !dir.is_dir() {
        bail!("{text} is neither a directory nor an address that begins with http:// or https://");
    }
    match folder::database(dir).exists() {
        true => Ok(Box::new(Publication::open(dir, None)?)),
        false => Ok(Box::new(Folder::at(dir))),
    }
}

/// Reads the genesis of a log. Without `network`, nothing shows that it is the genesis of the network that was meant.
pub fn genesis(source: &dyn Source, network: Option<&Digest>) -> Result<Genesis> {
    let Body::Genesis(genesis) = Entry::decode(&first_entry(source)?)?.body else {
        bail!("the log's first entry is not a genesis");
    };
    let found = genesis.network_id();
    match network {
        Some(expected) if *expected != found => {
            bail!("the log is of network {found}, and not of {expected}")
        }
        _ => Ok(genesis),
    }
}

/// Opens a published log, checks the signatures of its newest checkpoint, and reads from the log.
pub fn open_log<T, E>(
    from: &str,
    trust: &Trust,
    read: impl FnOnce(&PublishedLog<'_>, &VerifierKey, &WitnessPolicy) -> Result<T, E>,
) -> Result<T>
where
    anyhow::Error: From<E>,
{
    let source = source(from, trust.ca.as_deref())?;
    let key = genesis(source.as_ref(), trust.network.as_ref())?.verifier_key()?;
    let policy = trust
        .witness_policy
        .clone()
        .unwrap_or_else(WitnessPolicy::none);
    let log = PublishedLog::open(source.as_ref(), &key, &policy)?;
    Ok(read(&log, &key, &policy)?)
}
