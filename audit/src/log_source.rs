//! Finds logs by address or folder, and holds whose signatures an auditor trusts.

use anyhow::{anyhow, bail, Result};
use std::fmt;
use std::io::Read;
use std::path::{Path, PathBuf};
use zk0_circuits::Digest;
use zk0_ledger::error::LedgerError;
use zk0_ledger::folder;
use zk0_ledger::published::publication::Publication;
use zk0_ledger::published::reader::{first_entry, PublishedLog};
use zk0_ledger::published::source::{FolderSource, LogSource, SourceError};
use zk0_ledger::published::web::Web;
use zk0_ledger::store::Store;
use zk0_protocol::log_keys::LogKeys;
use zk0_protocol::tlog::checkpoint::log_key;
use zk0_protocol::tlog::layout::TILE_WIDTH;
use zk0_protocol::{Body, Entry, Genesis, VerifierKey, WitnessPolicy};

/// Whom an auditor trusts.
#[derive(Clone, Debug, Default)]
pub struct Trust {
    /// The log's network; `None` if the auditor does not know its id.
    pub network: Option<Digest>,
    /// The witnesses who must have cosigned the checkpoint. `None` takes the rules' ones, where the whole log is read.
    pub witness_policy: Option<WitnessPolicy>,
    /// The PEM file of authorities for HTTPS; by default the system's.
    pub ca: Option<PathBuf>,
}

/// The auditor's options do not fit the ledger, or name something that does not exist. Nothing was audited.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WrongUsage(pub String);

impl fmt::Display for WrongUsage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for WrongUsage {}

impl WrongUsage {
    /// `ledger` is of the network `found`, not of the named `expected`.
    pub fn other_network(ledger: &str, found: &Digest, expected: &Digest) -> Self {
        Self(format!(
            "{ledger} is of network {found}, but --network names {expected}: nothing was checked. Choose the right folder or address. If \
             this is where the ledger of that network should be, somebody has put another one in its place"
        ))
    }
}

/// A log at an address. The error states if something else answers there.
struct Address(Web);

impl LogSource for Address {
    fn open(&self, path: &str) -> Result<Option<Box<dyn Read>>, SourceError> {
        self.0.open(path).map_err(|mut error| {
            // The aggregator's own port speaks HTTP/2 and serves no log.
            if error.why.contains("http parse fail") {
                error.why.push_str(
                    ". This is not a published log. If it is the aggregator's own port, ask the operator for the address of the log \
                     (`zk0 aggregator serve --log-listen`, often port 7073)",
                );
            }
            error
        })
    }
}

/// Finds a log by address or folder. For `ca` see [`Trust::ca`].
///
/// # Errors
/// No such folder, or it cannot be published. [`WrongUsage`] if the address or `ca` is unusable.
pub fn source(text: &str, ca: Option<&Path>) -> Result<Box<dyn LogSource>> {
    if text.starts_with("http://") || text.starts_with("https://") {
        let web = Web::at(text, ca).map_err(|error| WrongUsage(error.to_string()))?;
        return Ok(Box::new(Address(web)));
    }
    let dir = Path::new(text);
    if !dir.is_dir() {
        bail!("{text} is neither a directory nor an address that begins with http:// or https://");
    }
    if folder::database(dir).exists() {
        Ok(Box::new(Publication::open(dir, None)?))
    } else {
        Ok(Box::new(FolderSource::at(dir)))
    }
}

/// Reads a log's genesis, without `network` perhaps another network's.
pub fn genesis(source: &dyn LogSource, network: Option<&Digest>) -> Result<Genesis> {
    let genesis = founder(&first_entry(source)?)?;
    let found = genesis.network_id();
    match network {
        Some(expected) if *expected != found => {
            Err(WrongUsage::other_network("the log", &found, expected).into())
        }
        _ => Ok(genesis),
    }
}

/// Reads the genesis of the log at an address or in a folder, published or not: a witness's operator needs the log's key before the first
/// cosignature.
///
/// # Errors
/// Those of [`source`]; or the first entry is unreadable or not a genesis.
pub fn genesis_at(from: &str, ca: Option<&Path>) -> Result<Genesis> {
    let dir = Path::new(from);
    let database = folder::database(dir);
    if !database.exists() {
        return genesis(source(from, ca)?.as_ref(), None);
    }
    let first = Store::open_read_only(&database)?.entry(0)?;
    let first = first.ok_or_else(|| LedgerError::NoLedger(dir.into()))?;
    founder(&first)
}

/// The key that signs the newest checkpoint of the published log at an address or in a folder, if it is the log's present one by its entries.
///
/// # Errors
/// Those of [`source`]; or the log is not published, or not valid.
pub fn present_key_at(from: &str, ca: Option<&Path>) -> Result<VerifierKey> {
    let source = source(from, ca)?;
    let genesis = genesis(source.as_ref(), None)?;
    let founding = genesis.verifier_key()?;
    let log = PublishedLog::open(source.as_ref(), &founding, &WitnessPolicy::none())?;
    let (mut keys, size) = (LogKeys::of(&genesis), log.checkpoint().size);
    for number in 0..size.div_ceil(TILE_WIDTH) {
        for (index, bytes) in (number * TILE_WIDTH..).zip(log.entries(number)?) {
            let followed = keys.follow(&genesis, index, &Entry::decode(&bytes)?.body);
            followed.map_err(|why| anyhow!("entry {index}: {why}"))?;
        }
    }
    let signer = log_key(genesis.origin(), log.signer())?;
    if log.signer() != keys.present() {
        bail!("the checkpoint of {size} entries is signed with {signer}, which is not the log's key there, and may be stolen");
    }
    Ok(signer)
}

fn founder(first: &[u8]) -> Result<Genesis> {
    match Entry::decode(first)?.body {
        Body::Genesis(genesis) => Ok(genesis),
        _ => bail!("the log's first entry is not a genesis"),
    }
}

/// Opens a published log, checks its newest checkpoint's signatures, and reads from it.
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
