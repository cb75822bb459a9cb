//! The folder of `--checkpoints`, for one network only: another one's weights must not pass as this one's.
//!
//! - `network`: the network's id, in hexadecimal
//! - `round-N`: the policy folder of round N
//! - `published`: the repository, and the last round published there, `OWNER/NAME N`
//!
//! Existing folders are kept. Published rounds are not published again.

use crate::hub::Repository;
use anyhow::{bail, Context, Result};
use std::fs;
use std::path::{Path, PathBuf};
use zk0_circuits::Digest;
use zk0_files::{atomic_file, bounded_file};

const NETWORK: &str = "network";
const PUBLISHED: &str = "published";
const MAX_BYTES: u64 = 1 << 10;

/// Has `folder` keep the policy folders of `network`, which has closed `closed` rounds. Makes a missing folder.
///
/// A folder of an earlier zk0 names no network. It becomes this one's if `holds_weights` is true of each of its rounds.
///
/// # Errors
/// The folder is another network's or does not show whose it is, or it cannot be read or written.
pub fn keep_to(
    folder: &Path,
    network: &Digest,
    closed: u64,
    holds_weights: impl Fn(u64, &Path) -> Result<bool>,
) -> Result<()> {
    let (path, shown) = (folder.join(NETWORK), folder.display());
    if let Some(text) = read(&path)? {
        let Ok(named) = text.trim().parse::<Digest>() else {
            bail!(
                "{} does not hold the id of a network: if the policy folders beside it are of this network, write {network} into it; otherwise name another folder with --checkpoints",
                path.display()
            );
        };
        if named != *network {
            bail!(
                "{shown} holds policy folders of network {named}, and this is network {network}: name another folder with --checkpoints"
            );
        }
        return Ok(());
    }
    atomic_file::create_folder(folder).with_context(|| format!("creating {shown}"))?;
    if let Err(why) = compare(folder, closed, holds_weights) {
        bail!(
            "{shown} does not state of which network its policy folders are ({why:#}): name another folder with --checkpoints; or, if you know that they are of this network, write its id into {}: {network}",
            path.display()
        );
    }
    write(&path, &format!("{network}\n"))
}

fn compare(
    folder: &Path,
    closed: u64,
    holds_weights: impl Fn(u64, &Path) -> Result<bool>,
) -> Result<()> {
    let (rounds, published) = (rounds(folder)?, published(folder)?);
    let published = published.map(|(_, round)| round);
    // This finds most wrong folders before weights are read.
    let unknown = (rounds.iter().copied().chain(published)).find(|round| *round >= closed);
    if let Some(round) = unknown {
        bail!("it has round {round}, which this network has not closed");
    }
    if rounds.is_empty() && published.is_some() {
        bail!("no policy folder is left there to compare with the ledger");
    }
    for round in rounds {
        let copy = round_folder(folder, round);
        let shown = copy.display();
        tracing::info!(round, "comparing {shown} with the ledger");
        let holds = holds_weights(round, &copy);
        if !holds.with_context(|| format!("comparing {shown} with the ledger"))? {
            bail!("{shown} does not hold the weights of this network after round {round}");
        }
    }
    Ok(())
}

/// The policy folder of a round.
pub fn round_folder(folder: &Path, round: u64) -> PathBuf {
    folder.join(format!("round-{round}"))
}

/// The rounds with policy folders, in ascending order.
///
/// # Errors
/// The folder cannot be read.
pub fn rounds(folder: &Path) -> Result<Vec<u64>> {
    let read = || -> std::io::Result<Vec<u64>> {
        let mut rounds = Vec::new();
        for entry in fs::read_dir(folder)? {
            let name = entry?.file_name();
            let number = name.to_str().and_then(|name| name.strip_prefix("round-"));
            rounds.extend(number.and_then(|number| number.parse::<u64>().ok()));
        }
        rounds.sort_unstable();
        Ok(rounds)
    };
    read().with_context(|| format!("reading {}", folder.display()))
}

fn published(folder: &Path) -> Result<Option<(String, u64)>> {
    let text = read(&folder.join(PUBLISHED))?;
    let reported = text.as_deref().and_then(|text| {
        let (repository, round) = text.trim().split_once(' ')?;
        Some((repository.to_owned(), round.parse().ok()?))
    });
    Ok(reported)
}

/// The round published last in this repository.
///
/// # Errors
/// The file cannot be read.
pub fn published_in(folder: &Path, repository: &Repository) -> Result<Option<u64>> {
    let reported = published(folder)?.filter(|(name, _)| *name == repository.to_string());
    Ok(reported.map(|(_, round)| round))
}

/// Records a published round.
///
/// # Errors
/// The file cannot be written.
pub fn note_published(folder: &Path, repository: &Repository, round: u64) -> Result<()> {
    write(&folder.join(PUBLISHED), &format!("{repository} {round}\n"))
}

fn read(path: &Path) -> Result<Option<String>> {
    let bytes = bounded_file::read_if_there(path, MAX_BYTES)
        .with_context(|| format!("reading {}", path.display()))?;
    Ok(bytes.map(|bytes| String::from_utf8_lossy(&bytes).into_owned()))
}

fn write(path: &Path, text: &str) -> Result<()> {
    atomic_file::replace(path, text.as_bytes())
        .with_context(|| format!("writing {}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::RefCell;

    const OURS: Digest = Digest([1; 32]);
    const TRIAL: Digest = Digest([2; 32]);

    fn never(round: u64, _: &Path) -> Result<bool> {
        panic!("the weights of round {round} are read")
    }

    fn unnamed(rounds: &[u64]) -> tempfile::TempDir {
        let dir = tempfile::tempdir().unwrap();
        for round in rounds {
            fs::create_dir(round_folder(dir.path(), *round)).unwrap();
        }
        dir
    }

    #[track_caller]
    fn refused(
        folder: &Path,
        closed: u64,
        holds_weights: impl Fn(u64, &Path) -> Result<bool>,
    ) -> String {
        let error = keep_to(folder, &OURS, closed, holds_weights).unwrap_err();
        assert!(!folder.join(NETWORK).exists());
        let reported = error.to_string();
        for part in ["--checkpoints", &OURS.to_string()] {
            assert!(reported.contains(part), "{reported}");
        }
        reported
    }

    #[test]
    fn a_folder_serves_the_network_that_used_it_first() {
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path().join("deep/policies");
        keep_to(&folder, &OURS, 0, never).unwrap();
        let named = fs::read_to_string(folder.join(NETWORK)).unwrap();
        assert_eq!(named, format!("{OURS}\n"));
        fs::create_dir(round_folder(&folder, 9)).unwrap();
        keep_to(&folder, &OURS, 10, never).unwrap();

        let reported = keep_to(&folder, &TRIAL, 10, never).unwrap_err().to_string();
        for part in [
            folder.to_str().unwrap(),
            &format!("of network {OURS}"),
            &format!("this is network {TRIAL}"),
            "--checkpoints",
        ] {
            assert!(reported.contains(part), "{reported}");
        }
        assert_eq!(fs::read_to_string(folder.join(NETWORK)).unwrap(), named);
    }

    #[test]
    fn a_file_that_names_no_network_is_not_replaced() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join(NETWORK);
        fs::write(&path, "my network").unwrap();
        let reported = keep_to(dir.path(), &OURS, 0, never).unwrap_err();
        let reported = reported.to_string();
        assert!(
            reported.contains("does not hold the id of a network")
                && reported.contains(&OURS.to_string()),
            "{reported}"
        );
        assert_eq!(fs::read_to_string(&path).unwrap(), "my network");
        fs::write(&path, OURS.to_string()).unwrap();
        keep_to(dir.path(), &OURS, 0, never).unwrap();
    }

    #[test]
    fn a_folder_of_an_earlier_release_is_kept_if_all_its_weights_are_the_networks() {
        let dir = unnamed(&[19, 9]);
        fs::create_dir(dir.path().join("round-29.unfinished")).unwrap();
        fs::write(dir.path().join("notes"), "mine").unwrap();
        let compared = RefCell::new(Vec::new());
        let all = |round, copy: &Path| {
            assert_eq!(copy, round_folder(dir.path(), round));
            compared.borrow_mut().push(round);
            Ok(true)
        };
        keep_to(dir.path(), &OURS, 20, all).unwrap();
        assert_eq!(compared.into_inner(), [9, 19]);
        keep_to(dir.path(), &OURS, 20, never).unwrap();
    }

    #[test]
    fn a_folder_with_weights_of_another_network_is_refused() {
        let dir = unnamed(&[9, 19]);
        let reported = refused(dir.path(), 20, |round, _| Ok(round != 9));
        assert!(
            reported.contains("round-9 does not hold the weights"),
            "{reported}"
        );
        let reported = refused(dir.path(), 20, |_, _| bail!("the blob was pruned"));
        assert!(
            reported.contains("with the ledger: the blob was pruned"),
            "{reported}"
        );
        let reported = refused(dir.path(), 0, never);
        assert!(
            reported.contains("round 9, which this network has not closed"),
            "{reported}"
        );
    }

    #[test]
    fn what_was_published_of_another_network_is_not_taken_for_this_ones() {
        let robots: Repository = "robots/arm".parse().unwrap();
        let dir = unnamed(&[9]);
        note_published(dir.path(), &robots, 99).unwrap();
        let reported = refused(dir.path(), 20, never);
        assert!(reported.contains("round 99, which"), "{reported}");
        note_published(dir.path(), &robots, 9).unwrap();
        keep_to(dir.path(), &OURS, 20, |_, _| Ok(true)).unwrap();
        let others: Repository = "others/arm".parse().unwrap();
        assert_eq!(published_in(dir.path(), &robots).unwrap(), Some(9));
        assert_eq!(published_in(dir.path(), &others).unwrap(), None);

        // The policy folders may have moved away.
        let dir = unnamed(&[]);
        assert_eq!(published_in(dir.path(), &robots).unwrap(), None);
        note_published(dir.path(), &robots, 9).unwrap();
        let reported = refused(dir.path(), 20, never);
        assert!(reported.contains("no policy folder is left"), "{reported}");
    }
}
