//! Arguments whose blinding a test chooses, and whose challenges follow from the statement alone.

use crate::models::Models;
use std::collections::HashMap;
use std::io;
use zk0_argument::commitment::parameters::{cap_bits, CAP, FOLDS, SALT, SIBLINGS};
use zk0_argument::commitment::prove::Hiding;
use zk0_argument::expert::argument::prove::{prove_with, Hidden};
use zk0_argument::expert::argument::{argued, verify_with, DrawnPoints, LeftColumns, Shape};
use zk0_argument::expert::evaluation::layers::Expert;
use zk0_argument::expert::prover_values::{evaluate, Common, SampleValues};
use zk0_argument::expert::statement::Statement;
use zk0_argument::field::{Extension, Goldilocks};
use zk0_argument::prove::progress::silently;
use zk0_argument::prove::Proving;
use zk0_argument::prove::SourceValues;
use zk0_argument::transcript::{Prover, Refused, Verifier};
use zk0_circuits::model::layout::{expert_tensors, Layout};
use zk0_circuits::{Digest, EvalSpec, QuantisedWeights};
use zk0_testkit::claims::{FloatSample, Random};

/// Elements that look random, the same for a seed and a number.
pub fn elements(seed: u64, count: usize) -> Vec<Goldilocks> {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    let next = |_| {
        state = state
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        Goldilocks::from_i64(((state ^ state >> 29) >> 1) as i64)
    };
    (0..count).map(next).collect()
}

/// Elements of each column of a tree: those that were chosen, and others.
#[derive(Clone, Default)]
pub struct Chosen {
    pub seed: u64,
    pub columns: HashMap<usize, Vec<Goldilocks>>,
}

impl Hiding for Chosen {
    fn elements(&self, column: usize, count: usize) -> Vec<Goldilocks> {
        match self.columns.get(&column) {
            Some(chosen) => chosen[..count].to_vec(),
            None => elements(self.seed << 20 | column as u64, count),
        }
    }

    fn salts(&self, first: usize, count: usize) -> Vec<[Goldilocks; SALT]> {
        let of = |leaf: usize| elements(!(self.seed << 32 | leaf as u64), SALT);
        let salts = (first..first + count).map(|leaf| [of(leaf)[0], of(leaf)[1]]);
        salts.collect()
    }
}

/// What hides an argument: all but samples, and each sample.
#[derive(Clone, Default)]
pub struct Blinding {
    pub argument: Chosen,
    pub samples: Vec<Chosen>,
}

impl Blinding {
    /// One that looks random.
    pub fn of(seed: u64, samples: u64) -> Self {
        let chosen = |number| Chosen {
            seed: seed + number,
            columns: HashMap::new(),
        };
        Self {
            argument: chosen(0),
            samples: (1..=samples).map(chosen).collect(),
        }
    }
}

/// A statement, and all values behind it.
pub struct Made {
    pub statement: Statement,
    pub shape: Shape,
    common: Common,
    pub witnesses: Vec<SampleValues>,
}

impl Made {
    pub fn new(models: &Models) -> Self {
        let weights = [&models.base, &models.update];
        let context = Digest([7; 32]);
        let statement =
            evaluate(context, &models.spec, weights, &models.samples, &silently).unwrap();
        let expert = Expert::new(&statement);
        let common = Common::new(&statement, weights);
        let sample_values = |number| {
            SampleValues::of(&statement, &common, number, weights, &models.samples).unwrap()
        };
        Self {
            witnesses: (0..models.samples.len()).map(sample_values).collect(),
            shape: Shape::new(&expert),
            statement,
            common,
        }
    }

    /// The argument with this blinding.
    pub fn argue(&self, blinding: &Blinding, deaf: bool) -> Prover {
        self.argue_by(blinding, deaf, |proving, expert, shape| {
            argued(proving, expert, shape)
        })
    }

    /// The argument that `argued` makes with this blinding.
    pub fn argue_by(
        &self,
        blinding: &Blinding,
        deaf: bool,
        argued: impl FnOnce(
            &mut Proving<'_>,
            &Expert,
            &Shape,
        ) -> Result<LeftColumns<Extension>, Refused>,
    ) -> Prover {
        let sample_values = |number: usize| Ok::<_, io::Error>(self.witnesses[number].clone());
        let hidden = Hidden {
            argument: Box::new(blinding.argument.clone()),
            sample: &|number, _| Box::new(blinding.samples[number].clone()),
            deaf,
        };
        let (statement, common) = (&self.statement, &self.common);
        prove_with(
            statement,
            common,
            hidden,
            None,
            &silently,
            sample_values,
            argued,
        )
        .unwrap()
    }

    /// The values of weights and tables.
    pub fn published(&self) -> [SourceValues<'_>; 2] {
        let [_, _, published @ ..] = self
            .common
            .sources(SourceValues::Wide(&[]), SourceValues::Wide(&[]));
        published
    }

    /// What was drawn in an argument whose challenges follow from the statement alone.
    pub fn drawn(&self, words: &[u64]) -> DrawnPoints {
        let verifier = Verifier::new(&self.statement.digest(), words).deaf();
        verify_with(&self.statement, verifier).unwrap().1
    }

    /// The values of all columns, in the order of their weights, but for the random ones.
    pub fn columns(&self) -> Vec<Vec<Goldilocks>> {
        let height = 1 << self.shape.parameters.variables();
        let cut = |values: &[i64], width: usize| -> Vec<Vec<Goldilocks>> {
            let columns = values.chunks_exact(height).take(width);
            columns
                .map(|column| column.iter().map(|&v| Goldilocks::from_i64(v)).collect())
                .collect()
        };
        let [main, data] = self.shape.widths;
        let main = self.witnesses.iter().flat_map(|own| cut(&own.main, main));
        let data = self.witnesses.iter().flat_map(|own| cut(&own.data, data));
        main.chain(data).collect()
    }

    /// Places of words of the end of a proof, which has so many.
    pub fn queries(&self, words: usize) -> Vec<Query> {
        let parameters = &self.shape.parameters;
        let length = parameters.variables() as u32 + 2;
        let segments = self.shape.segments();
        let path = |length: u32, cap: u32| 4 * (length - cap) as usize;
        let rows: Vec<usize> = segments.iter().map(|widths| widths.iter().sum()).collect();
        let opened: usize = rows.iter().map(|row| row + SALT + path(length, CAP)).sum();
        let steps = (1..=(parameters.variables() - 4) / FOLDS).map(|step| {
            let length = length - (FOLDS * step) as u32;
            2 * SIBLINGS + path(length, cap_bits(length))
        });
        let each = opened + steps.sum::<usize>();
        let first = words - parameters.positions() * each;
        let queries = (0..parameters.positions()).map(|query| {
            let mut place = first + query * each;
            let segments = rows.iter().map(|&row| {
                let values = place..place + row;
                place = values.end + SALT + path(length, CAP);
                (values.clone(), values.end + SALT..place)
            });
            Query {
                segments: segments.collect(),
            }
        });
        queries.collect()
    }
}

/// Of each segment the places of a row's values, and of the path.
pub struct Query {
    pub segments: Vec<(std::ops::Range<usize>, std::ops::Range<usize>)>,
}

/// The element of the extension at a place of words.
pub fn extension(words: &[u64], place: usize) -> Extension {
    let words = Goldilocks::of_words(&words[place..place + 2]).unwrap();
    Extension::of_coefficients(words)[0]
}

/// Models whose attention has no effect, and two lists of samples that differ in their keys and values alone. So both have the same losses.
pub fn alike(count: usize, seed: u64) -> [Models; 2] {
    let spec = EvalSpec::micro();
    [1, 2].map(|cache| {
        let mut models = Models::new(&spec, count, seed);
        for weights in [&mut models.base, &mut models.update] {
            let mut bytes = weights.as_bytes().to_vec();
            let tensors = expert_tensors(&spec.dims).into_iter();
            for (tensor, place) in tensors.zip(Layout::new(&spec.dims).tensors) {
                if tensor.name.contains("o_proj") {
                    bytes[2 * place.start..][..2 * place.len].fill(0);
                }
            }
            *weights = QuantisedWeights::from_bytes(&spec, &bytes).unwrap();
        }
        for (number, (sample, _)) in models.samples.iter_mut().enumerate() {
            let padded = number % 2;
            let mut parts = FloatSample::random(&spec, &mut Random(seed), 2, padded);
            parts.cache = FloatSample::random(&spec, &mut Random(seed + cache), 2, padded).cache;
            *sample = parts.quantise(&spec);
        }
        models
    })
}
