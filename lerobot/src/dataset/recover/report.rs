//! What was saved of a recording, and what was not.

use std::fmt;

/// What [`recover`](crate::dataset::recover) saved, and what it could not save.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Recovered {
    /// The episodes of the new folder, in order.
    pub saved: Vec<Saved>,
    /// Episodes that are not in it.
    pub lost: Vec<Lost>,
    /// What else differs from the folder that LeRobot would have written.
    pub notes: Vec<String>,
}

/// An episode that was saved.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Saved {
    /// The number under which it was recorded. In the new folder it is its place among the others.
    pub recorded_as: u64,
    /// Its frames.
    pub frames: usize,
    /// Whether zk0 made its videos of the pictures that the recording left.
    pub encoded_here: bool,
}

/// An episode that could not be saved.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Lost {
    /// The number under which it was recorded.
    pub episode: i64,
    /// Why.
    pub cause: String,
}

impl Recovered {
    /// Frames of all episodes that were saved.
    pub fn frames(&self) -> usize {
        self.saved.iter().map(|episode| episode.frames).sum()
    }
}

impl fmt::Display for Lost {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "episode {}: {}", self.episode, self.cause)
    }
}
