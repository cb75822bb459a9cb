//! What was saved of a recording, and what was not.

use std::fmt;

/// What [`recover`](crate::dataset::recover) saved, and what it could not.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Recovered {
    /// Episodes of the new folder, in order.
    pub saved: Vec<Saved>,
    /// Episodes that are not in it.
    pub lost: Vec<Lost>,
    /// Other differences from the folder that LeRobot would have written.
    pub notes: Vec<String>,
}

/// An episode that was saved.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Saved {
    /// Its number in the recording. In the new folder, its place is its number.
    pub recorded_as: u64,
    /// Its frames.
    pub frames: usize,
    /// Whether zk0 encoded its videos from leftover pictures.
    pub encoded_here: bool,
}

/// A lost episode.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Lost {
    /// Its number in the recording.
    pub episode: i64,
    /// Why.
    pub cause: String,
}

impl Recovered {
    /// Frames of all saved episodes.
    pub fn frames(&self) -> usize {
        self.saved.iter().map(|episode| episode.frames).sum()
    }
}

impl fmt::Display for Lost {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "episode {}: {}", self.episode, self.cause)
    }
}
