//! Receipts as files: `tlog-proof` bundles (C2SP tlog-proof), verifiable offline with the log's key and a policy.
//!
//! The bundle's extra data is the entry, so the file is complete. The proof covers it, because its hash is the leaf.

use crate::entries::codec::EntryError;
use crate::entries::entry::MAX_ENTRY_BYTES;
use crate::tlog::checkpoint::CheckpointError;
use crate::tlog::decimal::decimal;
use crate::tlog::receipt::Receipt;
use crate::tlog::verifier_key::VerifierKey;
use crate::tlog::witness_policy::{WitnessPolicy, Witnessed};
use crate::Entry;
use base64::prelude::{Engine as _, BASE64_STANDARD};
use tlog_tiles::tlog::{check_record, record_hash, Hash};
use zk0_circuits::Digest;

const HEADER: &str = "c2sp.org/tlog-proof@v1";

/// Longest bundle, in bytes: an entry in base64, a path and a cosigned checkpoint.
pub const MAX_PROOF_BYTES: usize = 2 * MAX_ENTRY_BYTES + crate::tlog::checkpoint::MAX_NOTE_BYTES;

/// Most hashes in a proof: no tree is higher.
const MAX_HASHES: usize = 63;

/// A proof of an entry in a log, verifiable offline.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TlogProof {
    /// Extra data; here the entry's canonical bytes.
    pub extra: Option<Vec<u8>>,
    /// The entry's position, from 0.
    pub index: u64,
    /// RFC 6962 audit path, from the leaf upwards.
    pub hashes: Vec<Digest>,
    /// The signed checkpoint with its cosignatures.
    pub checkpoint: Vec<u8>,
}

/// Why a bundle is not a valid proof.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ProofError {
    /// The text is not a bundle.
    #[error("this is not a tlog-proof: {0}")]
    Form(String),
    /// Neither the bundle nor the caller gives the entry.
    #[error("the proof does not hold its entry (no `extra` line): give the entry too")]
    NoEntry,
    /// Its checkpoint is not valid.
    #[error("proof: {0}")]
    Checkpoint(#[from] CheckpointError),
    /// The proven bytes are not an entry.
    #[error("proof: {0}")]
    Entry(#[from] EntryError),
    /// The path does not lead to the checkpoint's root.
    #[error("the proof does not show that entry {index} is in the tree of {size} entries: {why}")]
    NotIncluded { index: u64, size: u64, why: String },
}

impl From<Receipt> for TlogProof {
    fn from(receipt: Receipt) -> Self {
        Self {
            extra: Some(receipt.entry),
            index: receipt.index,
            hashes: receipt.proof,
            checkpoint: receipt.checkpoint,
        }
    }
}

impl TlogProof {
    /// The text of a `.tlog-proof` file.
    pub fn encode(&self) -> Vec<u8> {
        let mut text = format!("{HEADER}\n");
        if let Some(extra) = &self.extra {
            text.push_str(&format!("extra {}\n", BASE64_STANDARD.encode(extra)));
        }
        text.push_str(&format!("index {}\n", self.index));
        for hash in &self.hashes {
            text.push_str(&format!("{}\n", Hash(hash.0)));
        }
        text.push('\n');
        [text.as_bytes(), &self.checkpoint].concat()
    }

    /// Reads a bundle; [`TlogProof::verify`] reads its checkpoint.
    pub fn decode(bytes: &[u8]) -> Result<Self, ProofError> {
        let form = |why: &str| ProofError::Form(why.into());
        if bytes.len() > MAX_PROOF_BYTES {
            return Err(form("it is too long"));
        }
        let text = std::str::from_utf8(bytes).map_err(|_| form("it is not UTF-8"))?;
        let (head, checkpoint) = text
            .split_once("\n\n")
            .ok_or_else(|| form("it has no empty line before the checkpoint"))?;
        let mut lines = head.split('\n').peekable();
        if lines.next() != Some(HEADER) {
            return Err(form("its first line is not c2sp.org/tlog-proof@v1"));
        }
        let extra = match lines.next_if(|line| line.starts_with("extra ")) {
            Some(line) => Some(
                BASE64_STANDARD
                    .decode(&line["extra ".len()..])
                    .map_err(|_| form("its extra data is not base64"))?,
            ),
            None => None,
        };
        let index = lines
            .next()
            .and_then(|line| line.strip_prefix("index "))
            .and_then(decimal)
            .ok_or_else(|| form("it has no line `index N`"))?;
        let hashes: Vec<Digest> = lines
            .map(|line| {
                Hash::parse_hash(line)
                    .map(|hash| Digest(hash.0))
                    .map_err(|_| form("a line of its path is not the base64 of 32 bytes"))
            })
            .take(MAX_HASHES + 1)
            .collect::<Result<_, _>>()?;
        if hashes.len() > MAX_HASHES {
            return Err(form("its path has more hashes than any tree has levels"));
        }
        Ok(Self {
            extra,
            index,
            hashes,
            checkpoint: checkpoint.as_bytes().into(),
        })
    }

    /// Verifies the log's signature, the quorum of `policy`, and that the entry in `extra` is in the signed tree.
    pub fn verify(
        &self,
        log: &VerifierKey,
        policy: &WitnessPolicy,
    ) -> Result<(Witnessed, Entry), ProofError> {
        let bytes = self.extra.as_deref().ok_or(ProofError::NoEntry)?;
        let witnessed = self.verify_leaf(log, policy, bytes)?;
        Ok((witnessed, Entry::decode(bytes)?))
    }

    /// As [`TlogProof::verify`], for a leaf that the caller has.
    pub fn verify_leaf(
        &self,
        log: &VerifierKey,
        policy: &WitnessPolicy,
        leaf: &[u8],
    ) -> Result<Witnessed, ProofError> {
        let witnessed = policy.open(&self.checkpoint, log)?;
        let Digest(root) = witnessed.checkpoint.root;
        check_record(
            &self.hashes.iter().map(|hash| Hash(hash.0)).collect(),
            witnessed.checkpoint.size,
            Hash(root),
            self.index,
            record_hash(leaf),
        )
        .map_err(|error| ProofError::NotIncluded {
            index: self.index,
            size: witnessed.checkpoint.size,
            why: error.to_string(),
        })?;
        Ok(witnessed)
    }
}
