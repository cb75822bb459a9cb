//! Instructions to token ids.

use sha2::{Digest, Sha256};
use zk0_lerobot::config::PolicyConfig;
use zk0_lerobot::error::Result;
use zk0_lerobot::tokenizer::{Tokenizer, TrainedTokenizer};

/// The tokenizer of a policy's instructions.
pub enum PolicyTokenizer {
    /// Hashed words.
    WordHash(WordHash),
    /// The policy's own.
    Trained(Box<TrainedTokenizer>),
}

impl PolicyTokenizer {
    /// Hashed words for these dimensions.
    pub fn word_hash(config: &PolicyConfig) -> Self {
        Self::WordHash(WordHash::new(config))
    }

    /// The `tokenizer.json` behind it; `None` for hashed words.
    pub fn definition(&self) -> Option<&str> {
        match self {
            Self::WordHash(_) => None,
            Self::Trained(trained) => Some(trained.definition()),
        }
    }
}

impl From<TrainedTokenizer> for PolicyTokenizer {
    fn from(trained: TrainedTokenizer) -> Self {
        Self::Trained(Box::new(trained))
    }
}

impl Tokenizer for PolicyTokenizer {
    fn tokens(&self, task: &str) -> Result<Vec<u32>> {
        match self {
            Self::WordHash(hash) => hash.tokens(task),
            Self::Trained(trained) => trained.tokens(task),
        }
    }
}

/// One token a word, for policies without a trained tokenizer.
///
/// Words are maximal runs of letters and digits, lowercased. An id is the first 8 bytes of the word's SHA-256, big-endian, modulo
/// `vocabulary - 1`: the last id is padding. Words after `max_language_tokens` are dropped.
#[derive(Clone, Debug)]
pub struct WordHash {
    vocabulary: usize,
    limit: usize,
}

impl WordHash {
    /// For a policy's vocabulary and instruction length.
    pub fn new(config: &PolicyConfig) -> Self {
        Self {
            vocabulary: config.text.vocabulary,
            limit: config.max_language_tokens,
        }
    }
}

impl Tokenizer for WordHash {
    fn tokens(&self, task: &str) -> Result<Vec<u32>> {
        let words = task
            .split(|c: char| !c.is_alphanumeric())
            .filter(|w| !w.is_empty());
        let ids = words.take(self.limit).map(|word| {
            let hash = Sha256::digest(word.to_lowercase().as_bytes());
            let number = hash
                .iter()
                .take(8)
                .fold(0u64, |n, byte| n << 8 | u64::from(*byte));
            (number % (self.vocabulary as u64 - 1).max(1)) as u32
        });
        Ok(ids.collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::profile::Profile;

    #[test]
    fn case_and_punctuation_do_not_matter_and_the_length_is_bounded() {
        let tokenizer = WordHash::new(&Profile::Micro.config());
        let tokens = |task| tokenizer.tokens(task).unwrap();
        assert_eq!(
            tokens("Stack the red cube on top."),
            tokens("stack, the RED cube")
        );
        assert_ne!(tokens("put the red cube"), tokens("put the green cube"));
        assert_eq!(tokens(""), Vec::<u32>::new());
        assert!(tokens("a b c d e f").iter().all(|id| *id < 127));
        assert_eq!(tokens("a b c d e f").len(), 4);
    }

    #[test]
    fn ids_are_what_the_rule_says() {
        // sha256("red") begins with b1f51a511f1da0cd.
        let tokenizer = WordHash::new(&Profile::Micro.config());
        assert_eq!(tokenizer.tokens("red").unwrap(), [78]);
    }
}
