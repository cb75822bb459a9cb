//! The encoding of a statement: a list of words, which is hashed, and which the guest reads.
//!
//! A statement has one encoding. In this order: the length of the evaluation's own encoding, and its bytes, eight to a word; both digests of
//! weights; the number of scales, and those of both models, four to a word; the number of samples, and for each its prefix, frames and time
//! in one word, its losses, and its noise, four values to a word. Zeros fill the last word of a list.

use super::statement::{Evaluated, Statement};
use crate::hash::{digest_of_words, Digest, Domain};
use alloc::vec::Vec;
use zk0_circuits::model::draw::Draw;
use zk0_circuits::model::layout::Layout;
use zk0_circuits::model::linear::bit_limits;
use zk0_circuits::model::spec::SpecError;
use zk0_circuits::EvalSpec;

/// Why words are not a statement.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NotAStatement {
    /// The evaluation is not valid.
    #[error(transparent)]
    Spec(#[from] SpecError),
    /// There are too few words or too many, or some are not as they have to be.
    #[error("the words do not encode a statement")]
    Encoding,
    /// A number is beyond what the evaluation allows.
    #[error("{0} in a statement are out of bounds")]
    Bounds(&'static str),
}

/// Most samples of a statement.
const MOST_SAMPLES: usize = 1 << 8;

/// Four values to a word.
fn push_values(words: &mut Vec<u64>, values: &[i16]) {
    words.extend(values.chunks(4).map(|chunk| {
        let shifted = chunk.iter().zip([0, 16, 32, 48]);
        shifted.fold(0, |word, (&value, shift)| {
            word | (value as u16 as u64) << shift
        })
    }));
}

/// What is left to read.
struct Reader<'a>(&'a [u64]);

impl<'a> Reader<'a> {
    fn words(&mut self, count: usize) -> Result<&'a [u64], NotAStatement> {
        let (now, later) = self
            .0
            .split_at_checked(count)
            .ok_or(NotAStatement::Encoding)?;
        self.0 = later;
        Ok(now)
    }

    fn word(&mut self) -> Result<u64, NotAStatement> {
        Ok(self.words(1)?[0])
    }

    fn values(&mut self, count: usize) -> Result<Vec<i16>, NotAStatement> {
        let words = self.words(count.div_ceil(4))?;
        let mut values = Vec::with_capacity(4 * words.len());
        for &word in words {
            values.extend([word, word >> 16, word >> 32, word >> 48].map(|value| value as i16));
        }
        match values.split_off(count).iter().all(|&value| value == 0) {
            true => Ok(values),
            false => Err(NotAStatement::Encoding),
        }
    }

    fn digest(&mut self) -> Result<zk0_circuits::Digest, NotAStatement> {
        let mut digest = [0; 32];
        let words = self.words(4)?;
        for (bytes, word) in digest.as_chunks_mut::<8>().0.iter_mut().zip(words) {
            *bytes = word.to_le_bytes();
        }
        Ok(zk0_circuits::Digest(digest))
    }
}

impl Statement {
    /// A digest of all of it, with which a transcript begins.
    pub fn digest(&self) -> Digest {
        digest(&self.encode())
    }

    /// The encoding.
    pub fn encode(&self) -> Vec<u64> {
        let spec = self.spec.encode();
        let mut words = Vec::with_capacity(spec.len());
        words.push(spec.len() as u64);
        words.extend(spec.chunks(8).map(|chunk| {
            let mut bytes = [0; 8];
            bytes[..chunk.len()].copy_from_slice(chunk);
            u64::from_le_bytes(bytes)
        }));
        for digest in &self.weights {
            let chunks = digest.0.as_chunks::<8>().0.iter();
            words.extend(chunks.map(|bytes| u64::from_le_bytes(*bytes)));
        }
        words.push(self.scales[0].len() as u64);
        for scales in &self.scales {
            push_values(&mut words, scales);
        }
        words.push(self.samples.len() as u64);
        for sample in &self.samples {
            let numbers = (sample.prefix as u64) << 32 | (sample.frames as u64) << 16;
            words.push(numbers | sample.draw.time as u64);
            words.extend(sample.losses);
            push_values(&mut words, &sample.draw.noise);
        }
        words
    }

    /// Reads an encoding, and checks all that [`super::evaluation::layers::Expert`] relies on.
    pub fn decode(words: &[u64]) -> Result<Self, NotAStatement> {
        let mut reader = Reader(words);
        let length = usize::try_from(reader.word()?).map_err(|_| NotAStatement::Encoding)?;
        let bytes: Vec<u8> = reader
            .words(length.div_ceil(8))?
            .iter()
            .flat_map(|word| word.to_le_bytes())
            .collect();
        let (own, rest) = bytes.split_at(length);
        if rest.iter().any(|&byte| byte != 0) {
            return Err(NotAStatement::Encoding);
        }
        let spec = EvalSpec::decode(own)?;
        let weights = [reader.digest()?, reader.digest()?];
        let tensors = Layout::new(&spec.dims).tensors.len();
        if reader.word()? != tensors as u64 {
            return Err(NotAStatement::Bounds("numbers of scales"));
        }
        let scales = [reader.values(tensors)?, reader.values(tensors)?];
        let limits = bit_limits(&spec, tensors);
        let within = |scales: &Vec<i16>| {
            let mut all = scales.iter().zip(&limits);
            all.all(|(bits, (least, most))| least <= bits && bits <= most)
        };
        if !scales.iter().all(within) {
            return Err(NotAStatement::Bounds("scales"));
        }
        let count = reader.word()? as usize;
        if !(1..=MOST_SAMPLES).contains(&count) {
            return Err(NotAStatement::Bounds("numbers of samples"));
        }
        let samples = (0..count)
            .map(|_| reader.sample(&spec))
            .collect::<Result<_, _>>()?;
        match reader.0.is_empty() {
            true => Ok(Self {
                spec,
                weights,
                scales,
                samples,
            }),
            false => Err(NotAStatement::Encoding),
        }
    }
}

/// The digest of the statement with this encoding.
pub fn digest(words: &[u64]) -> Digest {
    digest_of_words(Domain::Statement, words)
}

impl Reader<'_> {
    fn sample(&mut self, spec: &EvalSpec) -> Result<Evaluated, NotAStatement> {
        let dims = &spec.dims;
        let numbers = self.word()?;
        let (prefix, frames) = (numbers >> 32, numbers >> 16 & 0xffff);
        if prefix > dims.max_prefix as u64 || frames > dims.chunk as u64 {
            return Err(NotAStatement::Bounds("a sample's sizes"));
        }
        let losses = self.words(2)?;
        // Each of up to 2^18 squared errors is below 2^36, and as i64 a loss has to be an element of the field.
        if losses.iter().any(|&loss| loss >= 1 << 54) {
            return Err(NotAStatement::Bounds("losses"));
        }
        let noise = self.values(dims.chunk as usize * dims.max_action_dim as usize)?;
        Ok(Evaluated {
            prefix: prefix as usize,
            frames: frames as usize,
            draw: Draw {
                time: numbers as u16,
                noise,
            },
            losses: [losses[0], losses[1]],
        })
    }
}
