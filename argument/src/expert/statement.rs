//! What an argument shows: the losses of two models on samples, by the evaluation of [`zk0_circuits::model::eval`].

use crate::hash::{digest_of_words, SpongeDigest, SpongeDomain};
use crate::transcript::{require, Refused};
use alloc::vec;
use alloc::vec::Vec;
use zk0_circuits::model::draw::Draw;
use zk0_circuits::model::layout::Layout;
use zk0_circuits::model::linear::bit_limits;
use zk0_circuits::EvalSpec;

/// Most samples of a statement.
pub const MOST_SAMPLES: usize = 1 << 8;

/// One evaluated sample, as both sides know it.
#[derive(Clone, Debug)]
pub struct EvaluatedSample {
    /// Valid tokens of the prefix.
    pub prefix: usize,
    /// Frames up to the last one that is not padding.
    pub frames: usize,
    /// Flow time and noise.
    pub draw: Draw,
    /// The sums of squared errors of the base and the update.
    pub losses: [u64; 2],
}

/// A statement.
#[derive(Clone, Debug)]
pub struct Statement {
    /// A digest of what determines the specification, both sets of weights and what was drawn. The transcript begins with it. Otherwise a prover
    /// could choose these when it knows the challenges.
    pub context: zk0_circuits::Digest,
    /// The evaluation. It is valid.
    pub spec: EvalSpec,
    /// Fraction bits of each of the expert's tensors, for the base and the update.
    pub scales: [Vec<i16>; 2],
    /// Whether a value of the base saturates on one of the samples, or attention scores lie further apart than the table of powers reaches. Then more is
    /// committed to. It is no part of what is shown: a statement that does not need it can have it.
    pub saturates: bool,
    /// The samples.
    pub samples: Vec<EvaluatedSample>,
}

/// Four values to a word. Zeros fill the last word.
pub fn packed(values: &[i16]) -> impl Iterator<Item = u64> + '_ {
    values.chunks(4).map(|chunk| {
        let shifted = chunk.iter().zip([0, 16, 32, 48]);
        shifted.fold(0, |word, (&value, shift)| {
            word | (value as u16 as u64) << shift
        })
    })
}

impl Statement {
    /// A statement about weights with these scales and one empty sample. Its relations place weights and tables as those of all such statements do.
    pub fn of_weights(spec: &EvalSpec, scales: [Vec<i16>; 2]) -> Self {
        let dims = &spec.dims;
        Self {
            context: zk0_circuits::Digest::default(),
            spec: spec.clone(),
            scales,
            saturates: false,
            samples: vec![EvaluatedSample {
                prefix: 1,
                frames: 1,
                draw: Draw {
                    time: 0,
                    noise: vec![0; dims.chunk as usize * dims.max_action_dim as usize],
                },
                losses: [0; 2],
            }],
        }
    }

    /// The statement about one of the samples, or about none. Its relations are those of the whole statement, but for what each sample states.
    #[cfg(feature = "prove")]
    pub fn of(&self, sample: Option<usize>) -> Self {
        let samples = sample.and_then(|sample| self.samples.get(sample));
        Self {
            samples: samples.into_iter().cloned().collect(),
            ..self.clone()
        }
    }

    /// A digest of all that the context does not determine, and of the context. In this order: the context; the number of scales, and those of both
    /// models, four to a word; whether the base saturates, and the number of samples in one word, and for each its prefix and frames in one word, and its losses.
    pub fn digest(&self) -> SpongeDigest {
        let context = self.context.0.as_chunks::<8>().0.iter();
        let mut words: Vec<u64> = context.map(|bytes| u64::from_le_bytes(*bytes)).collect();
        for scales in &self.scales {
            words.push(scales.len() as u64);
            words.extend(packed(scales));
        }
        words.push((self.saturates as u64) << 32 | self.samples.len() as u64);
        for sample in &self.samples {
            words.push((sample.prefix as u64) << 32 | sample.frames as u64);
            words.extend(sample.losses);
        }
        digest_of_words(SpongeDomain::Statement, &words)
    }

    /// Checks the bounds that [`super::evaluation::layers::Expert`] relies on.
    pub fn check_bounds(&self) -> Result<(), Refused> {
        let dims = &self.spec.dims;
        let tensors = Layout::new(dims).tensors.len();
        let limits = bit_limits(&self.spec, tensors);
        for scales in &self.scales {
            let count = scales.len() == tensors;
            require(count, Refused::Bounds("the number of scales"))?;
            let mut all = scales.iter().zip(&limits);
            let within = all.all(|(bits, (least, most))| least <= bits && bits <= most);
            require(within, Refused::Bounds("a scale"))?;
        }
        let count = (1..=MOST_SAMPLES).contains(&self.samples.len());
        require(count, Refused::Bounds("the number of samples"))?;
        let noise = dims.chunk as usize * dims.max_action_dim as usize;
        for sample in &self.samples {
            let prefix = (1..=dims.max_prefix as usize).contains(&sample.prefix);
            require(prefix, Refused::Bounds("the prefix of a sample"))?;
            let frames = (1..=dims.chunk as usize).contains(&sample.frames);
            require(frames, Refused::Bounds("the frames of a sample"))?;
            // Each of up to 2^18 squared errors is below 2^36, and as i64 a loss has to be an element of the field.
            let losses = sample.losses.iter().all(|&loss| loss < 1 << 54);
            require(losses, Refused::Bounds("a loss"))?;
            let drawn = sample.draw.noise.len() == noise;
            require(drawn, Refused::Bounds("the noise of a sample"))?;
        }
        Ok(())
    }
}
