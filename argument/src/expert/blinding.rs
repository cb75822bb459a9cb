//! Where the randomness comes from that hides samples.

use crate::commitment::parameters::SALT;
use crate::commitment::prove::Hiding;
use crate::field::goldilocks::P;
use crate::field::Goldilocks;
use crate::hash::SpongeDigest;
use rand_chacha::rand_core::{RngCore, SeedableRng};
use rand_chacha::ChaCha20Rng;
use std::io;
use zk0_circuits::vm::digest::tagged_sha256;

/// The secret of a registered dataset: what hides its samples in arguments follows from it and from them. Whoever has it can find out whether a guess of
/// a sample is right, so the node gives it to nobody but its auditors, and never uses it for a second registration.
pub struct Blind([u8; 32]);

impl Blind {
    /// From 32 bytes that nobody can guess.
    pub const fn new(bytes: [u8; 32]) -> Self {
        Self(bytes)
    }

    /// What hides a sample with this digest of its values, wherever it is opened.
    pub fn of_sample(&self, values: &zk0_circuits::Digest) -> BlindingKeys {
        BlindingKeys(tagged_sha256("zk0/blind/sample/v1", &[&self.0, &values.0]).0)
    }

    /// What hides all else in an argument for a statement. It is new each time: it follows from 32 bytes of the system, and from the secret, in
    /// case these can be guessed.
    ///
    /// # Errors
    /// The system has no random bytes.
    pub fn of_argument(&self, statement: &SpongeDigest) -> io::Result<BlindingKeys> {
        let mut fresh = [0; 32];
        getrandom::fill(&mut fresh).map_err(|error| io::Error::other(error.to_string()))?;
        let statement = zk0_circuits::Digest::from(*statement);
        let parts: [&[u8]; 3] = [&self.0, &fresh, &statement.0];
        Ok(BlindingKeys(
            tagged_sha256("zk0/blind/argument/v1", &parts).0,
        ))
    }
}

/// The key of a stream of ChaCha20 for each column of a tree, and one for its salts.
pub struct BlindingKeys([u8; 32]);

impl BlindingKeys {
    fn stream(&self, number: u64) -> ChaCha20Rng {
        let mut stream = ChaCha20Rng::from_seed(self.0);
        stream.set_stream(number);
        stream
    }
}

impl Hiding for BlindingKeys {
    /// Words from p on are thrown away, so that no element is likelier than another.
    fn elements(&self, column: usize, count: usize) -> Vec<Goldilocks> {
        let mut stream = self.stream(column as u64);
        let words = core::iter::repeat_with(|| stream.next_u64());
        let elements = words.filter(|&word| word < P).map(Goldilocks::canonical);
        elements.take(count).collect()
    }

    /// They need not be quite uniform.
    fn salts(&self, first: usize, count: usize) -> Vec<[Goldilocks; SALT]> {
        const WORDS: u128 = 2; // of 32 bits, in one of 64
        let mut stream = self.stream(u64::MAX);
        stream.set_word_pos((first * SALT) as u128 * WORDS);
        let mut element = |_| Goldilocks::canonical(stream.next_u64());
        (0..count)
            .map(|_| core::array::from_fn(&mut element))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STATEMENT: SpongeDigest = SpongeDigest([1, 2, 3, 4]);

    fn hidden(keys: &BlindingKeys) -> Vec<Goldilocks> {
        let salts = keys.salts(0, 4).into_flattened();
        [keys.elements(0, 8), keys.elements(1, 8), salts].concat()
    }

    /// Nothing is used twice: each column, the salts, each argument and each sample have their own.
    #[test]
    fn streams_have_nothing_in_common() {
        let [one, other] = [[5; 32], [6; 32]].map(Blind::new);
        let [a, b] = [[7; 32], [8; 32]].map(zk0_circuits::Digest);
        let of_argument = |blind: &Blind| blind.of_argument(&STATEMENT).unwrap();
        let all = [
            one.of_sample(&a),
            one.of_sample(&b),
            other.of_sample(&a),
            of_argument(&one),
            of_argument(&one),
        ];
        let mut all: Vec<u64> = all.iter().flat_map(hidden).map(Goldilocks::value).collect();
        let count = all.len();
        all.sort_unstable();
        all.dedup();
        assert_eq!(all.len(), count);
    }

    /// A sample is hidden by the same whenever it is opened, and rows are asked for one by one.
    #[test]
    fn what_hides_a_sample_stays_the_same() {
        let values = zk0_circuits::Digest([7; 32]);
        let keys = || Blind::new([5; 32]).of_sample(&values);
        assert_eq!(hidden(&keys()), hidden(&keys()));
        assert_eq!(keys().elements(3, 5), keys().elements(3, 9)[..5]);
        let salts = keys().salts(0, 50);
        for first in 0..50 {
            assert_eq!(keys().salts(first, 1), salts[first..=first]);
        }
    }
}
