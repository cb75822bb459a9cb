//! Finds, by content, episodes that merges of copies repeat, in one recording or several.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, HashMap};
use std::fmt;
use std::path::PathBuf;

use crate::dataset::Dataset;

/// Episodes of a recording that this or an earlier recording already has.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CopiedEpisodes {
    /// The recording with the copies.
    pub recording: PathBuf,
    /// The recording that has them first.
    pub of: PathBuf,
    /// Whether both are one recording.
    pub within_one: bool,
    /// The copies, as the files number them.
    pub episodes: Vec<usize>,
    /// The first copy and its original, as the files number them.
    pub first: (usize, usize),
}

impl CopiedEpisodes {
    /// Finds the copies in recordings that are used together: the same frames per second, states and actions to the last bit
    /// ([`Dataset::episode_digests`]). Pictures may be encoded again.
    pub fn among<'a>(recordings: impl IntoIterator<Item = &'a Dataset>) -> Vec<Self> {
        let mut known = HashMap::new();
        let mut copied: BTreeMap<(usize, usize), Self> = BTreeMap::new();
        for (number, recording) in recordings.into_iter().enumerate() {
            for (digest, episode) in recording.episode_digests().zip(recording.episodes()) {
                let this = (number, recording, episode.recorded);
                let (of, original, first) = *known.entry(digest).or_insert(this);
                if (of, first) == (number, episode.recorded) {
                    continue;
                }
                match copied.entry((number, of)) {
                    Entry::Occupied(mut found) => {
                        found.get_mut().episodes.push(episode.recorded);
                    }
                    Entry::Vacant(place) => {
                        place.insert(Self {
                            recording: recording.root().into(),
                            of: original.root().into(),
                            within_one: of == number,
                            episodes: vec![episode.recorded],
                            first: (episode.recorded, first),
                        });
                    }
                }
            }
        }
        copied.into_values().collect()
    }
}

impl fmt::Display for CopiedEpisodes {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let (copy, original) = self.first;
        let of = if self.within_one {
            String::new()
        } else {
            format!(" of {}", self.of.display())
        };
        let recording = self.recording.display();
        write!(
            f,
            "{recording}: {} of its episodes are copies: episode {copy} has the states and actions of episode {original}{of}. Training counts them \
             twice, and a copy of a held-out episode may be trained on; ",
            self.episodes.len()
        )?;
        if self.within_one {
            write!(
                f,
                "remove them with lerobot-edit-dataset --repo_id NAME --root {recording} --operation.type delete_episodes \
                 --operation.episode_indices '{:?}' --new_root NEW_FOLDER",
                self.episodes
            )
        } else {
            f.write_str("use one of the two recordings alone")
        }
    }
}
