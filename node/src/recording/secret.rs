//! What hides a node's samples. The file `secret` of its state folder has one secret for each registration, and counts how often each leaf
//! was opened under it.
//!
//! An argument opens a few rows of the commitment to each of its samples. A sample stays hidden as long as no more than
//! [`zk0_argument::claim::most_uses`] arguments open it. So the count is on disk before the argument is made. A node that has lost its
//! counts stops, and explains how to register the recording under a fresh secret.

use crate::error::ParticipantError;
use crate::state_files::{self, at};
use borsh::{BorshDeserialize, BorshSerialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use zk0_argument::claim::Blind;
use zk0_circuits::claim::dataset::salt_commitment;
use zk0_circuits::vm::digest::tagged_sha256;
use zk0_circuits::{DatasetCommitment, Digest};
use zk0_files::atomic_file;
use zk0_smolvla::frames::prefix_cache::CacheKey;

const MAGIC: &[u8] = b"zk0-node-secret/1\n";
const CHECKSUM: &str = "zk0/node-secret/checksum/v1";
/// A registration of 512 samples takes 6 KB.
pub const MAX_BYTES: u64 = 16 << 20;

/// 32 random bytes for one registration.
#[derive(Clone, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct RegistrationSecret([u8; 32]);

impl RegistrationSecret {
    /// Of these bytes.
    pub const fn new(bytes: [u8; 32]) -> Self {
        Self(bytes)
    }

    /// A fresh one.
    ///
    /// # Errors
    /// The system gives no random bytes.
    pub fn fresh() -> Result<Self, ParticipantError> {
        let mut bytes = [0; 32];
        getrandom::fill(&mut bytes).map_err(ParticipantError::Random)?;
        Ok(Self(bytes))
    }

    /// The salt of the leaves.
    pub fn salt(&self) -> [u8; 32] {
        self.derived("zk0/node-secret/salt/v1", &[]).0
    }

    /// What hides the samples in their commitments and in arguments.
    pub fn blind(&self) -> Blind {
        Blind::new(self.derived("zk0/node-secret/blind/v1", &[]).0)
    }

    /// Whether a dataset was registered under it.
    pub fn is_of(&self, dataset: &DatasetCommitment) -> bool {
        salt_commitment(&self.salt()) == dataset.salt_commitment
    }

    /// It differs under another secret.
    pub(super) fn name(&self, frame: &CacheKey) -> Digest {
        self.derived("zk0/node-secret/sample-file/v1", &frame.0)
    }

    fn derived(&self, tag: &str, of: &[u8]) -> Digest {
        tagged_sha256(tag, &[&self.0, of])
    }
}

/// The secrets of a node, the oldest first.
#[derive(Default, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Secrets(Vec<Used>);

#[derive(PartialEq, Eq, BorshSerialize, BorshDeserialize)]
struct Used {
    secret: RegistrationSecret,
    /// Arguments by leaf. A missing leaf was in none.
    opened: BTreeMap<u64, u32>,
}

enum Uncounted {
    /// No more arguments may open this leaf.
    WornOut {
        leaf: u64,
        opened: u32,
    },
    Unknown,
}

impl Secrets {
    /// The file.
    pub fn path(state: &Path) -> PathBuf {
        state.join("secret")
    }

    /// The secret of the last registration, or of the next one.
    pub fn newest(&self) -> Option<&RegistrationSecret> {
        self.0.last().map(|used| &used.secret)
    }

    /// The one before the newest.
    pub fn before(&self) -> Option<&RegistrationSecret> {
        let before = self.0.len().checked_sub(2)?;
        self.0.get(before).map(|used| &used.secret)
    }

    /// The secret of this registered dataset.
    pub fn of(&self, dataset: &DatasetCommitment) -> Option<&RegistrationSecret> {
        let mut secrets = self.0.iter().map(|used| &used.secret);
        secrets.find(|secret| secret.is_of(dataset))
    }

    /// Adds one, which is then the newest.
    pub fn add(&mut self, secret: RegistrationSecret) {
        self.0.push(Used {
            secret,
            opened: BTreeMap::new(),
        });
    }

    /// Whether no argument was made under it.
    pub fn is_unused(&self, secret: &RegistrationSecret) -> bool {
        self.find(secret).is_none_or(|used| used.opened.is_empty())
    }

    /// Whether a leaf has come to 80 % of `most` arguments.
    pub fn is_worn(&self, secret: &RegistrationSecret, most: u32) -> bool {
        let worn = |opened: &u32| 5 * u64::from(*opened) >= 4 * u64::from(most);
        self.find(secret)
            .is_some_and(|used| used.opened.values().any(worn))
    }

    fn find(&self, secret: &RegistrationSecret) -> Option<&Used> {
        self.0.iter().find(|used| used.secret == *secret)
    }

    /// Counts an argument about these leaves, each of which `most` arguments may open.
    ///
    /// # Errors
    /// A leaf is worn out. Then nothing is counted.
    fn count(
        &mut self,
        secret: &RegistrationSecret,
        leaves: &[u64],
        most: u32,
    ) -> Result<(), Uncounted> {
        let mut own = self.0.iter_mut().filter(|used| used.secret == *secret);
        let opened = &mut own.next().ok_or(Uncounted::Unknown)?.opened;
        let so_far = |leaf: &u64| opened.get(leaf).copied().unwrap_or_default();
        let mut counts: Vec<_> = leaves.iter().map(|leaf| (*leaf, so_far(leaf))).collect();
        if let Some((leaf, opened)) = counts.iter().find(|(_, opened)| *opened >= most) {
            let (leaf, opened) = (*leaf, *opened);
            return Err(Uncounted::WornOut { leaf, opened });
        }
        counts.iter_mut().for_each(|(_, opened)| *opened += 1);
        opened.extend(counts);
        Ok(())
    }

    /// As the file has them.
    pub fn encode(&self) -> Vec<u8> {
        let secrets = borsh::to_vec(self).expect("writing to a Vec cannot fail");
        let mut bytes = [MAGIC, &secrets].concat();
        bytes.extend(tagged_sha256(CHECKSUM, &[&bytes]).0);
        bytes
    }

    /// Reads what [`Self::encode`] has written.
    ///
    /// # Errors
    /// Other bytes. The text states what is wrong.
    pub fn decode(bytes: &[u8]) -> Result<Self, String> {
        if !bytes.starts_with(MAGIC) {
            return Err("it does not begin as a file of secrets does".into());
        }
        let (all, checksum) = bytes
            .split_last_chunk::<32>()
            .ok_or_else(|| format!("it is cut off after {} bytes", bytes.len()))?;
        if tagged_sha256(CHECKSUM, &[all]).0 != *checksum {
            return Err("its checksum is wrong, so it is cut off or damaged".into());
        }
        let secrets = all.strip_prefix(MAGIC).unwrap_or_default();
        borsh::from_slice(secrets).map_err(|error| error.to_string())
    }

    /// Reads the file; `None` if it is missing.
    ///
    /// # Errors
    /// It cannot be read, or is damaged.
    pub fn read(state: &Path) -> Result<Option<Self>, ParticipantError> {
        let path = Self::path(state);
        let damaged = |why| no_secret(state, format!("{} is damaged: {why}", path.display()));
        let bytes = match state_files::read(&path, MAX_BYTES) {
            Err(ParticipantError::BrokenFile { why, .. }) => return Err(damaged(why)),
            other => other?,
        };
        let secrets = bytes.map(|bytes| Self::decode(&bytes));
        secrets.transpose().map_err(damaged)
    }

    /// Reads the file of a registered recording.
    ///
    /// # Errors
    /// Those of [`Self::read`], and it is missing.
    pub fn of_registered(state: &Path) -> Result<Self, ParticipantError> {
        Self::read(state)?.ok_or_else(|| {
            let path = Self::path(state);
            no_secret(state, format!("{} is not there any more", path.display()))
        })
    }

    /// Writes the file, for its owner alone.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn keep(&self, state: &Path) -> Result<(), ParticipantError> {
        let path = Self::path(state);
        atomic_file::replace_private(&path, &self.encode()).map_err(at(&path))
    }
}

/// Counts an argument about these leaves, each of which `most` arguments may open. The count is on disk when this returns. A failed
/// argument counts, too.
///
/// # Errors
/// A leaf is worn out; or the file fails. Then the argument must not be made.
pub fn count(
    state: &Path,
    secret: &RegistrationSecret,
    leaves: &[u64],
    most: u32,
) -> Result<(), ParticipantError> {
    let mut secrets = Secrets::of_registered(state)?;
    secrets
        .count(secret, leaves, most)
        .map_err(|why| match why {
            Uncounted::WornOut { leaf, opened } => ParticipantError::WornOut {
                leaf,
                opened,
                folder: state.into(),
            },
            Uncounted::Unknown => of_another(state),
        })?;
    secrets.keep(state)
}

/// The error for a file without the secret of the registered dataset.
pub fn of_another(state: &Path) -> ParticipantError {
    let path = Secrets::path(state);
    let why = format!(
        "{} does not have the secret of the registered dataset",
        path.display()
    );
    no_secret(state, why)
}

fn no_secret(state: &Path, why: String) -> ParticipantError {
    ParticipantError::NoSecret {
        folder: state.into(),
        why,
    }
}
