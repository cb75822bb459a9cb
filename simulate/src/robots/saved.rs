//! A simulation on disk.

use crate::robots::error::SimulationError;
use crate::robots::federation::{GlobalState, Robots};
use borsh::{BorshDeserialize, BorshSerialize};
use std::path::{Path, PathBuf};
use zk0_circuits::Digest;
use zk0_files::{atomic_file, bounded_file};
use zk0_node::exchanged_weights::Base;
use zk0_protocol::rules::closing::server_moments::ServerMoments;

/// For all but weight files and moments (8 bytes a weight).
const FIELDS_BYTES: u64 = 1 << 20;

#[derive(BorshSerialize, BorshDeserialize)]
struct SavedRound {
    /// Of what is simulated.
    of: Digest,
    rounds: u64,
    base: Vec<u8>,
    earlier: Option<Vec<u8>>,
    moments: Option<(ServerMoments, Vec<u8>)>,
}

fn path(out: &Path) -> PathBuf {
    out.join("simulation")
}

/// Whether `out` holds a simulation.
pub fn exists(out: &Path) -> bool {
    path(out).exists()
}

/// Saves a simulation after `rounds` rounds to disk. `of` identifies policy, recordings and options.
///
/// # Errors
/// The file cannot be written.
pub fn keep(
    out: &Path,
    of: Digest,
    rounds: u64,
    robots: &Robots,
    global: &GlobalState,
) -> Result<(), SimulationError> {
    let file = |base: &Base| robots.format().write(&base.quantised);
    let saved = SavedRound {
        of,
        rounds,
        base: file(&global.base),
        earlier: global.earlier.as_ref().map(file),
        moments: global.moments.clone(),
    };
    let path = path(out);
    let written = borsh::to_vec(&saved).and_then(|bytes| atomic_file::replace(&path, &bytes));
    written.map_err(|error| failed(&path, error))
}

/// The finished rounds in `out`, and the next one's start.
///
/// # Errors
/// The file cannot be read, or belongs to another simulation than `of`.
pub fn read(
    out: &Path,
    of: Digest,
    robots: &Robots,
) -> Result<(u64, GlobalState), SimulationError> {
    let path = path(out);
    let limit = 8 * robots.format().file_bytes() + FIELDS_BYTES;
    let bytes = bounded_file::read(&path, limit).map_err(|error| failed(&path, error))?;
    let saved: SavedRound = borsh::from_slice(&bytes).map_err(|error| failed(&path, error))?;
    if saved.of != of {
        return Err(SimulationError::Saved(format!(
            "{} is a simulation with another policy, other recordings or other options: go on with those, or choose another --out",
            path.display()
        )));
    }
    let base = |file: &Vec<u8>| Base::read(robots.format(), &robots.config, file);
    let global = GlobalState {
        base: base(&saved.base)?,
        earlier: saved.earlier.as_ref().map(base).transpose()?,
        moments: saved.moments,
        trained: Vec::new(),
    };
    Ok((saved.rounds, global))
}

fn failed(path: &Path, error: std::io::Error) -> SimulationError {
    SimulationError::File {
        what: path.display().to_string(),
        error,
    }
}
