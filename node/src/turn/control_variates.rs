//! Control variates on the node's disk: a cache that saves downloading all rounds before each round. The ledger gives the same numbers.

use crate::error::ParticipantError;
use crate::state_files::{self, at};
use borsh::{BorshDeserialize, BorshSerialize};
use sha2::{Digest as _, Sha256};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use zk0_circuits::{Digest, NodeId};
use zk0_files::atomic_file::{self, Durability};
use zk0_protocol::rules::network_rules::Scaffold;
use zk0_smolvla::train::scaffold::ControlVariates;
use zk0_smolvla::{ExpertWeights, PolicyConfig};

/// Room for other fields and for the identities of nodes.
const FIELDS_BYTES: u64 = 64 << 20;
/// Bytes of the file for each byte of weights that travel: two float32 numbers for an int16.
const OF_WEIGHTS: u64 = 4;

/// Whose control variates they are, and by which rule.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Whose {
    /// The network.
    pub network: Digest,
    /// The node.
    pub node: NodeId,
    /// How it trains.
    pub rule: Scaffold,
}

/// Control variates, and the rounds that they follow from.
pub struct KeptVariates {
    /// The first round that counts.
    pub first: u64,
    /// The first round after those that count.
    pub next: u64,
    /// The contributors of these rounds.
    pub contributed: BTreeSet<NodeId>,
    /// What follows from them.
    pub variates: ControlVariates,
}

/// The tensors are safetensors files.
#[derive(BorshSerialize, BorshDeserialize)]
struct File {
    whose: Whose,
    first: u64,
    next: u64,
    contributed: BTreeSet<NodeId>,
    global: Vec<u8>,
    own: Option<Vec<u8>>,
}

impl KeptVariates {
    /// Those that begin with 0 before `round`, for weights like these.
    pub fn begin(round: u64, like: &ExpertWeights) -> Self {
        Self {
            first: round,
            next: round,
            contributed: BTreeSet::new(),
            variates: ControlVariates::zero(like.tensors()),
        }
    }

    /// Reads the file, if it is whole and is `whose`. Weights that travel have at most `limit` bytes.
    ///
    /// # Errors
    /// The file system fails.
    pub fn read(
        state: &Path,
        whose: &Whose,
        config: &PolicyConfig,
        limit: u64,
    ) -> Result<Option<Self>, ParticipantError> {
        let path = path(state);
        let limit = limit
            .saturating_mul(OF_WEIGHTS)
            .saturating_add(FIELDS_BYTES);
        let read = match state_files::read(&path, limit) {
            Ok(Some(bytes)) => Self::of_bytes(&bytes, whose, config),
            Ok(None) => return Ok(None),
            Err(ParticipantError::BrokenFile { why, .. }) => Err(why),
            Err(error) => return Err(error),
        };
        Ok(read.unwrap_or_else(|why| {
            let path = path.display();
            tracing::warn!("{path} is not what this node wrote there ({why}); the node computes it again from the ledger");
            None
        }))
    }

    /// The content of a file; `None` if it is of another network, key or rule. The error states what is wrong with it.
    fn of_bytes(
        bytes: &[u8],
        whose: &Whose,
        config: &PolicyConfig,
    ) -> Result<Option<Self>, String> {
        let whole = bytes.split_last_chunk::<32>();
        let whole = whole.filter(|(bytes, hash)| Sha256::digest(bytes)[..] == hash[..]);
        let (bytes, _) = whole.ok_or("its SHA-256 is another one")?;
        let file: File = borsh::from_slice(bytes).map_err(|error| error.to_string())?;
        if file.whose != *whose {
            return Ok(None);
        }
        let tensors = |bytes: &[u8]| match ExpertWeights::from_safetensors(config, bytes) {
            Ok(weights) => Ok(weights.into_tensors()),
            Err(error) => Err(error.to_string()),
        };
        Ok(Some(Self {
            first: file.first,
            next: file.next,
            contributed: file.contributed,
            variates: ControlVariates {
                global: tensors(&file.global)?,
                own: file.own.as_deref().map(tensors).transpose()?,
            },
        }))
    }

    /// Writes them to disk.
    ///
    /// # Errors
    /// The file system fails.
    pub fn keep(
        &self,
        state: &Path,
        whose: &Whose,
        config: &PolicyConfig,
    ) -> Result<(), ParticipantError> {
        let ControlVariates { global, own } = &self.variates;
        let stored = |tensors: &BTreeMap<_, _>| {
            ExpertWeights::from_tensors(config, tensors.clone())?.to_safetensors()
        };
        let file = File {
            whose: *whose,
            first: self.first,
            next: self.next,
            contributed: self.contributed.clone(),
            global: stored(global)?,
            own: own.as_ref().map(stored).transpose()?,
        };
        let path = path(state);
        let mut bytes = borsh::to_vec(&file).map_err(at(&path))?;
        let hash = Sha256::digest(&bytes);
        bytes.extend(hash);
        atomic_file::write(&path, Durability::Cache, |out| out.write_all(&bytes)).map_err(at(&path))
    }
}

fn path(state: &Path) -> PathBuf {
    state.join("control-variates")
}
