//! Founds a network: stores its policy and first weights, writes the genesis, and enrols nodes.

use crate::clock::Clock;
use ed25519_dalek::SigningKey;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use zk0_circuits::{Digest, EvalSpec, Mode, WeightsDigest};
use zk0_ledger::blobs::{BlobWriter, Blobs};
use zk0_ledger::{folder, BlobError, Ledger, LedgerError};
use zk0_protocol::entries::entry::ENTRY_VERSION;
use zk0_protocol::entries::member::NodeEnrolled;
use zk0_protocol::rules::closing::public_samples::PublicSamples;
use zk0_protocol::{Body, Entry, Genesis, Rules, State};
use zk0_verifier::public_samples::PublicSampleFile;

/// What a network begins with.
pub struct Founding {
    /// The network's name.
    pub name: String,
    /// Random bytes that distinguish networks of one name.
    pub nonce: [u8; 32],
    /// The network's rules.
    pub rules: Rules,
    /// The verifying key of the program that proves claims.
    pub program: Vec<u8>,
    /// How the evaluation is proven.
    pub mode: Mode,
    /// How claims are evaluated.
    pub evaluation: EvalSpec,
    /// The expert's weights for round 0, as a safetensors file.
    pub initial: Vec<u8>,
    /// Their digest in fixed point, under `mode`.
    pub quantised: Digest,
    /// The file of the public samples, if the rules name some.
    pub public_samples: Option<Vec<u8>>,
}

/// Why a network was not founded.
#[derive(Debug, thiserror::Error)]
pub enum FoundingError {
    /// A file is in the place of the ledger's folder, or of one above it.
    #[error("{} is a file, and a ledger needs a folder: choose another path", .0.display())]
    NoFolder(PathBuf),
    /// The folder holds a ledger already.
    #[error(
        "{} already holds a ledger: `zk0 aggregator serve {} --key FILE` continues its network; to found another one, choose another folder",
        .0.display(), .0.display()
    )]
    Taken(PathBuf),
    /// The ledger cannot be made.
    #[error(transparent)]
    Ledger(#[from] LedgerError),
    /// The weights cannot be stored.
    #[error(transparent)]
    Blob(#[from] BlobError),
    /// The policy cannot be stored.
    #[error("storing the policy file, which may have {limit} bytes at most because nodes download no larger one: {error}")]
    Policy {
        /// The limit, in bytes.
        limit: u64,
        /// What went wrong.
        error: io::Error,
    },
    /// The file of the rules' public samples is missing or unusable.
    #[error("the rules name the public samples {blob}, on which the results of rounds are evaluated: {why}")]
    PublicSamples {
        /// The file by the rules.
        blob: Digest,
        /// What is wrong.
        why: String,
    },
    /// A node cannot be enrolled.
    #[error("enrolling {name}: {error}")]
    Enrol {
        /// The node's name.
        name: String,
        /// What went wrong.
        error: LedgerError,
    },
}

impl Founding {
    /// Founds the network in `dir`. `write_policy` writes the policy file, of at most `limit` bytes, and returns its SHA-256, so the file
    /// is not in memory beside the policy.
    ///
    /// # Errors
    /// `dir` holds a ledger already, or the file system fails.
    pub fn found(
        self,
        dir: &Path,
        key: SigningKey,
        clock: &dyn Clock,
        limit: u64,
        write_policy: impl FnOnce(&mut dyn Write) -> io::Result<[u8; 32]>,
    ) -> Result<Ledger, FoundingError> {
        check_free(dir)?;
        self.check_public_samples()?;
        // The blobs come first, so that no ledger names missing weights.
        let blobs = Blobs::at(dir);
        let mut blob = BlobSink(blobs.writer(limit)?);
        let mut out = BufWriter::with_capacity(1 << 20, &mut blob);
        let written = write_policy(&mut out).and_then(|digest| out.flush().map(|()| digest));
        drop(out);
        let policy = Digest(written.map_err(|error| FoundingError::Policy { limit, error })?);
        blob.0.finish(&policy)?;
        if let Some(samples) = &self.public_samples {
            blobs.put(samples)?;
        }
        let genesis = Genesis {
            name: self.name,
            log_key: key.verifying_key().to_bytes(),
            nonce: self.nonce,
            rules: self.rules,
            program: self.program,
            mode: self.mode,
            evaluation: self.evaluation.encode(),
            policy,
            initial: WeightsDigest {
                blob: blobs.put(&self.initial)?,
                quantised: self.quantised,
            },
        };
        Ok(Ledger::create(dir, genesis, key, clock.now_ms())?.0)
    }

    /// Without these samples, no round could close.
    fn check_public_samples(&self) -> Result<(), FoundingError> {
        let Some(rule) = self.rules.public_samples else {
            return Ok(());
        };
        match &self.public_samples {
            Some(bytes) => check_public_samples(&self.evaluation, &rule, bytes),
            None => Err(FoundingError::PublicSamples {
                blob: rule.blob,
                why: "the file is not given".into(),
            }),
        }
    }
}

/// Checks a file against the public samples of `rule`, at the dimensions of `spec`.
pub fn check_public_samples(
    spec: &EvalSpec,
    rule: &PublicSamples,
    bytes: &[u8],
) -> Result<(), FoundingError> {
    let read = PublicSampleFile::read(spec, *rule, bytes);
    read.map(drop)
        .map_err(|error| FoundingError::PublicSamples {
            blob: rule.blob,
            why: error.to_string(),
        })
}

/// Checks that `dir` is or can become a folder, and holds no ledger.
///
/// # Errors
/// It holds one, or a file is in its place.
pub fn check_free(dir: &Path) -> Result<(), FoundingError> {
    let there = dir.ancestors().find(|path| path.exists());
    if let Some(file) = there.filter(|path| !path.is_dir()) {
        return Err(FoundingError::NoFolder(file.to_owned()));
    }
    if folder::checkpoint(dir).exists() {
        Err(FoundingError::Taken(dir.to_owned()))
    } else {
        Ok(())
    }
}

/// Checks that a network can begin with `genesis` at this time, and that its rules admit these nodes in turn. Writes nothing, and does not
/// read the genesis' digests.
///
/// # Errors
/// The rules refuse the genesis or a node.
pub fn check_nodes(
    genesis: Genesis,
    nodes: &[NodeEnrolled],
    time_ms: u64,
) -> Result<(), FoundingError> {
    let entry = |body| Entry {
        version: ENTRY_VERSION,
        time_ms,
        body,
    };
    let mut state = State::found(&entry(Body::Genesis(genesis))).map_err(LedgerError::from)?;
    // No rule about nodes depends on the tree.
    let root = Digest([0; 32]);
    for enrolled in nodes {
        let applied = state.apply(&root, &entry(Body::NodeEnrolled(enrolled.clone())));
        applied.map_err(|violation| FoundingError::Enrol {
            name: enrolled.name.clone(),
            error: violation.into(),
        })?;
    }
    Ok(())
}

/// Enrols nodes.
///
/// # Errors
/// The rules refuse a node, or the file system fails.
pub fn enrol(
    ledger: &mut Ledger,
    nodes: Vec<NodeEnrolled>,
    clock: &dyn Clock,
) -> Result<(), FoundingError> {
    for enrolled in nodes {
        let (name, node) = (enrolled.name.clone(), enrolled.node);
        ledger
            .append(clock.now_ms(), Body::NodeEnrolled(enrolled))
            .map_err(|error| FoundingError::Enrol {
                name: name.clone(),
                error,
            })?;
        tracing::info!("enrolled {name} ({node})");
    }
    Ok(())
}

struct BlobSink(BlobWriter);

impl Write for BlobSink {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.write(bytes).map_err(io::Error::other)?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
