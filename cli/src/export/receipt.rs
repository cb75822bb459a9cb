//! The receipt of an exported policy folder: the log's entry with its weights, and each file's SHA-256.

use super::closing::ClosingProof;
use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io;
use std::path::Path;
use zk0_circuits::Digest;
use zk0_files::{atomic_file, bounded_file};

/// The receipt's file name.
pub const RECEIPT: &str = "receipt.json";
/// The proof beside it, for `zk0 audit verify-proof`.
pub const PROOF: &str = "receipt.tlog-proof";

/// In bytes. Ten files take two thousand.
const MAX_RECEIPT: u64 = 1 << 20;

/// The content of a receipt.
#[derive(Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExportReceipt {
    /// The network's id.
    pub network: String,
    /// The log's name.
    pub log: String,
    /// The round that ended with these weights.
    pub round: u64,
    /// The log's entry that closes the round.
    pub entry: u64,
    /// SHA-256 of the entry's int16 weights.
    pub weights_sha256: String,
    /// SHA-256 of the founding policy file.
    pub policy_sha256: String,
    /// SHA-256 of each other file.
    pub files_sha256: BTreeMap<String, String>,
}

impl ExportReceipt {
    /// The receipt of the files in `folder`.
    ///
    /// # Errors
    /// A file cannot be read.
    pub fn of(closing: &ClosingProof, folder: &Path) -> Result<Self> {
        Ok(Self {
            network: closing.genesis.network_id().to_string(),
            log: closing.genesis.name.clone(),
            round: closing.closed.round,
            entry: closing.proof.index,
            weights_sha256: closing.weights().to_string(),
            policy_sha256: closing.genesis.policy.to_string(),
            files_sha256: files(folder)?,
        })
    }

    /// Reads the receipt in `folder`.
    ///
    /// # Errors
    /// There is none, or it is not a receipt.
    pub fn read(folder: &Path) -> Result<Self> {
        let path = folder.join(RECEIPT);
        let reading = || format!("reading {}", path.display());
        let bytes = bounded_file::read(&path, MAX_RECEIPT).with_context(reading)?;
        serde_json::from_slice(&bytes).with_context(reading)
    }

    /// Writes the receipt and the proof into `folder`.
    ///
    /// # Errors
    /// A file cannot be written.
    pub fn write(&self, closing: &ClosingProof, folder: &Path) -> Result<()> {
        let text = serde_json::to_vec_pretty(self)?;
        for (name, bytes) in [(RECEIPT, text), (PROOF, closing.proof.encode())] {
            let path = folder.join(name);
            atomic_file::replace(&path, &bytes)
                .with_context(|| format!("writing {}", path.display()))?;
        }
        Ok(())
    }
}

/// Except the receipt and its proof.
fn files(folder: &Path) -> Result<BTreeMap<String, String>> {
    let mut files = BTreeMap::new();
    let reading = |path: &Path| format!("reading {}", path.display());
    for entry in fs::read_dir(folder).with_context(|| reading(folder))? {
        let path = entry?.path();
        let name = path
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        if name == RECEIPT || name == PROOF || !path.is_file() {
            continue;
        }
        let mut hash = Sha256::new();
        let mut file = File::open(&path).with_context(|| reading(&path))?;
        io::copy(&mut file, &mut hash).with_context(|| reading(&path))?;
        files.insert(name, Digest(hash.finalize().into()).to_string());
    }
    Ok(files)
}
