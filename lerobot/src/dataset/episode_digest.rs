//! The digest of an episode shows when two recordings hold the same one.

use sha2::{Digest, Sha256};

use crate::dataset::Dataset;

/// Domain-separation tag of the digest.
pub const EPISODE_TAG: &str = "zk0:episode:v1";

impl Dataset {
    /// The digest of each episode, in order: SHA-256 of the tag, the frames per second and the number of frames (u64, little-endian), and
    /// each frame's `observation.state` and `action` as recorded (float32, little-endian).
    ///
    /// Pictures are left out, because encoding changes them; no two episodes move alike to the last bit. One changed bit changes the
    /// digest: this finds copies, not imitations. Anyone with an episode can tell from a node's digest that the node has it.
    pub fn episode_digests(&self) -> impl Iterator<Item = [u8; 32]> + '_ {
        self.episodes().iter().map(|episode| {
            let mut hash = Sha256::new();
            hash.update(EPISODE_TAG);
            hash.update(u64::from(self.fps()).to_le_bytes());
            hash.update((episode.frames.len() as u64).to_le_bytes());
            for frame in episode.frames.clone() {
                let values = [self.state(frame), self.action(frame)]
                    .into_iter()
                    .flatten();
                values
                    .flatten()
                    .for_each(|value| hash.update(value.to_le_bytes()));
            }
            hash.finalize().into()
        })
    }
}
