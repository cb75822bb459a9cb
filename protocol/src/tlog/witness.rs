//! The decisions of a witness (C2SP tlog-witness), without sockets, files or clocks. A witness remembers one checkpoint for each
//! log, and cosigns only a continuation of it. So a log cannot show two histories to readers who require this witness.

use crate::quote::short;
use crate::tlog::checkpoint::{Checkpoint, CheckpointError, Parsed, MAX_NOTE_BYTES};
use crate::tlog::cosigner::Cosigner;
use crate::tlog::decimal::decimal;
use crate::tlog::verifier_key::VerifierKey;
use std::collections::BTreeMap;
use tlog_tiles::tlog::{check_tree, Hash, EMPTY_HASH};
use zk0_circuits::Digest;

/// Most lines of a consistency proof.
const MAX_HASHES: usize = 63;

/// Longest request that is read, in bytes.
pub const MAX_REQUEST_BYTES: usize = 64 * 48 + MAX_NOTE_BYTES;

/// A request for a cosignature.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AddCheckpoint {
    /// Size of the witness' last checkpoint, as far as the client knows; 0 without one.
    pub old: u64,
    /// RFC 6962 consistency proof from that size to the new checkpoint.
    pub proof: Vec<Digest>,
    /// The new checkpoint.
    pub checkpoint: Vec<u8>,
}

/// Why a witness does not cosign.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum WitnessRefusal {
    /// The bytes are not a request, or contradict themselves.
    #[error("{0}")]
    Malformed(String),
    /// The witness does not watch this log.
    #[error("this witness does not watch the log '{0}'")]
    UnknownLog(String),
    /// The log did not sign the checkpoint.
    #[error("{0}")]
    NotSigned(CheckpointError),
    /// A former key of the log signed it. It may be stolen.
    #[error("a former key of the log has signed this checkpoint of {size} entries: entry {since} gave the log another key, and this witness has seen that")]
    FormerKey { size: u64, since: u64 },
    /// The client is wrong about the witness' last checkpoint.
    #[error("the last checkpoint that this witness cosigned has {last} entries, not {old}")]
    Conflict { last: u64, old: u64 },
    /// The witness cosigned another tree of the same size: the log shows two histories.
    #[error("this witness has cosigned another tree of {size} entries")]
    OtherTree { size: u64 },
    /// The proof does not show a continuation of the old tree. Anybody can send an honest log's checkpoint without its proof, so
    /// this is no evidence against the log.
    #[error("the proof does not show that the tree of {size} entries continues the one of {last} entries that this witness cosigned: {why}")]
    Inconsistent { last: u64, size: u64, why: String },
}

impl WitnessRefusal {
    /// The refusal's HTTP status.
    pub fn status(&self) -> u16 {
        match self {
            Self::Malformed(_) => 400,
            Self::NotSigned(_) | Self::FormerKey { .. } => 403,
            Self::UnknownLog(_) => 404,
            Self::Conflict { .. } | Self::OtherTree { .. } => 409,
            Self::Inconsistent { .. } => 422,
        }
    }
}

impl AddCheckpoint {
    /// The request's body.
    pub fn encode(&self) -> Vec<u8> {
        let mut text = format!("old {}\n", self.old);
        for hash in &self.proof {
            text.push_str(&format!("{}\n", Hash(hash.0)));
        }
        text.push('\n');
        [text.as_bytes(), &self.checkpoint].concat()
    }

    /// Reads a request's body, but not its checkpoint.
    pub fn decode(body: &[u8]) -> Result<Self, WitnessRefusal> {
        let malformed = |why: &str| WitnessRefusal::Malformed(why.into());
        if body.len() > MAX_REQUEST_BYTES {
            return Err(malformed("the request is too long"));
        }
        let text = std::str::from_utf8(body).map_err(|_| malformed("the request is not UTF-8"))?;
        let (head, checkpoint) = text
            .split_once("\n\n")
            .ok_or_else(|| malformed("there is no empty line before the checkpoint"))?;
        let mut lines = head.split('\n');
        let old = lines
            .next()
            .and_then(|line| line.strip_prefix("old "))
            .and_then(decimal)
            .ok_or_else(|| malformed("the first line is not `old SIZE`"))?;
        let proof: Vec<Digest> = lines
            .map(|line| {
                Hash::parse_hash(line)
                    .map(|hash| Digest(hash.0))
                    .map_err(|_| malformed("a line of the proof is not the base64 of 32 bytes"))
            })
            .take(MAX_HASHES + 1)
            .collect::<Result<_, _>>()?;
        if proof.len() > MAX_HASHES {
            return Err(malformed("the proof has more than 63 lines"));
        }
        Ok(Self {
            old,
            proof,
            checkpoint: checkpoint.as_bytes().into(),
        })
    }
}

/// The watched logs, and the last cosigned checkpoint of each.
pub struct Witness {
    cosigner: Cosigner,
    logs: BTreeMap<String, WatchedLog>,
}

struct WatchedLog {
    /// The founding key. Each checkpoint names the present one.
    key: VerifierKey,
    last: Option<Checkpoint>,
    /// The entry that gave the log the key of the last checkpoint.
    since: u64,
}

/// A checkpoint to cosign. Once it is on disk, [`Witness::record`] makes it the log's last one.
pub struct AcceptedCheckpoint {
    /// Its log.
    pub origin: String,
    /// The checkpoint.
    pub checkpoint: Checkpoint,
    /// The entry that gave the log the key that signed it; 0 for the founding key.
    pub since: u64,
    /// The cosignature line.
    pub cosignature: Vec<u8>,
    /// The checkpoint with only the log's signature and this cosignature.
    pub note: Vec<u8>,
}

impl Witness {
    /// A witness that watches no log yet.
    pub fn new(cosigner: Cosigner) -> Self {
        Self {
            cosigner,
            logs: BTreeMap::new(),
        }
    }

    /// Watches a log from its last cosigned checkpoint. `key` is the log's founding key, and an origin has one. `since` is the entry that gave
    /// the log the key of the last checkpoint.
    pub fn watch(
        &mut self,
        key: VerifierKey,
        last: Option<Checkpoint>,
        since: u64,
    ) -> Result<(), String> {
        if self.logs.contains_key(key.name()) {
            Err(format!("the log '{}' is named twice", key.name()))
        } else {
            let name = key.name().into();
            self.logs.insert(name, WatchedLog { key, last, since });
            Ok(())
        }
    }

    /// The key of its cosignatures.
    pub fn key(&self) -> &VerifierKey {
        self.cosigner.key()
    }

    /// The logs that it watches.
    pub fn logs(&self) -> impl Iterator<Item = &VerifierKey> {
        self.logs.values().map(|watched| &watched.key)
    }

    /// Decides on a request at `time_s`, in POSIX seconds, and changes nothing. The caller writes the note to disk, records it,
    /// and only then hands out the cosignature.
    pub fn check(&self, body: &[u8], time_s: u64) -> Result<AcceptedCheckpoint, WitnessRefusal> {
        let request = AddCheckpoint::decode(body)?;
        let parsed = Parsed::read(&request.checkpoint)
            .map_err(|error| WitnessRefusal::Malformed(error.to_string()))?;
        let watched = self
            .logs
            .get(&parsed.origin)
            .ok_or_else(|| WitnessRefusal::UnknownLog(short(&parsed.origin)))?;
        let signature = parsed
            .signed_by(&watched.key)
            .map_err(WitnessRefusal::NotSigned)?;
        let new = parsed.checkpoint;
        if request.old > new.size {
            return Err(WitnessRefusal::Malformed(format!(
                "the old size, {}, is larger than the checkpoint's, {}",
                request.old, new.size
            )));
        }
        let last = watched.last.map_or(0, |last| last.size);
        if request.old != last {
            return Err(WitnessRefusal::Conflict {
                last,
                old: request.old,
            });
        }
        // Only now: a log that was rolled back to its former key learns that it was.
        if signature.since < watched.since {
            return Err(WitnessRefusal::FormerKey {
                size: new.size,
                since: watched.since,
            });
        }
        continues(watched.last.as_ref(), &new, &request.proof)?;
        let cosignature = self.cosigner.cosign(parsed.note.text(), time_s);
        let note = signed_note::Note::new(parsed.note.text(), &signature.lines)
            .map_err(|error| WitnessRefusal::Malformed(error.to_string()))?;
        Ok(AcceptedCheckpoint {
            origin: parsed.origin,
            checkpoint: new,
            since: signature.since,
            note: [&note.to_bytes()[..], &cosignature].concat(),
            cosignature,
        })
    }

    /// Makes the accepted checkpoint its log's last one.
    pub fn record(&mut self, accepted: &AcceptedCheckpoint) {
        if let Some(watched) = self.logs.get_mut(&accepted.origin) {
            watched.last = Some(accepted.checkpoint);
            watched.since = accepted.since;
        }
    }
}

fn continues(
    last: Option<&Checkpoint>,
    new: &Checkpoint,
    proof: &[Digest],
) -> Result<(), WitnessRefusal> {
    let inconsistent = |why: &str| WitnessRefusal::Inconsistent {
        last: last.map_or(0, |last| last.size),
        size: new.size,
        why: why.into(),
    };
    if new.size == 0 && new.root.0 != EMPTY_HASH.0 {
        return Err(inconsistent("the empty tree has another root"));
    }
    match last {
        Some(last) if last.size == new.size && last.root != new.root => {
            Err(WitnessRefusal::OtherTree { size: new.size })
        }
        // Every tree continues the empty tree and itself, without a proof.
        _ if last.is_none_or(|last| last.size == 0 || last.size == new.size) => {
            if proof.is_empty() {
                Ok(())
            } else {
                Err(inconsistent("there is a proof where none is needed"))
            }
        }
        None => Ok(()),
        Some(last) => check_tree(
            &proof.iter().map(|hash| Hash(hash.0)).collect(),
            new.size,
            Hash(new.root.0),
            last.size,
            Hash(last.root.0),
        )
        .map_err(|error| inconsistent(&error.to_string())),
    }
}
