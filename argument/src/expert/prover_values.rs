//! The prover's values: those of samples and weights, the residual stream as [`super::trace`] gives it, and all others from the relations.

use super::builder::{DATA, MAIN, TABLES, WEIGHTS};
use super::evaluation::layers::Expert;
use super::published::tables;
use super::sample::prove::frames;
use super::sizes::{Sizes, L, M, N, T};
use super::statement::{EvaluatedSample, Statement};
use super::trace::{trace, LinearSums, Traced, EMBEDDED};
use crate::prove::filling::Filling;
use crate::prove::progress::{Phase, Tell};
use crate::prove::{Computed, NotInTable, SourceValues};
use crate::relation::{ColumnSource, Tensor};
use std::borrow::Cow;
use std::io;
use std::rc::Rc;
use zk0_circuits::claim::terms::Model;
use zk0_circuits::model::arithmetic::fixed::{saturated, Rescale};
use zk0_circuits::model::draw::Draw;
use zk0_circuits::model::eval::{EvalError, Evaluator};
use zk0_circuits::model::layout::Layout;
use zk0_circuits::model::linear::{first_of_layer, output, place};
use zk0_circuits::{Digest, EvalSpec, QuantisedWeights, Sample};

/// The base and the update.
pub type Models<'a> = [&'a QuantisedWeights; 2];

/// Why there is nothing to prove.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Unprovable {
    /// The evaluation fails.
    #[error("the {model} on sample {sample}: {error}")]
    Evaluation {
        /// Which model.
        model: Model,
        /// Which sample, from 0.
        sample: usize,
        /// Why.
        error: EvalError,
    },
    /// A value is beyond what the argument's tables hold.
    #[error(transparent)]
    NotInTable(#[from] NotInTable),
    /// A sample cannot be read.
    #[error("sample {sample} cannot be read: {reason}")]
    Sample {
        /// Which sample, from 0.
        sample: usize,
        /// Why.
        reason: String,
    },
    /// What is committed to does not go into a file: the disk is full, or the folder is not there.
    #[error("the committed values cannot be written to a file: {0}")]
    File(String),
    /// The relations give another value than the evaluation.
    #[error(
        "{tensor}: value {index} is {found} by the relations, and {expected} by the evaluation"
    )]
    Differs {
        /// The tensor.
        tensor: &'static str,
        /// The number of the value in its source.
        index: usize,
        /// By the evaluation.
        expected: i64,
        /// By the relations.
        found: i64,
    },
}

impl From<io::Error> for Unprovable {
    fn from(error: io::Error) -> Self {
        Self::File(error.to_string())
    }
}

/// The values that all samples share.
#[derive(Clone)]
pub struct Common {
    /// The weights, padded.
    pub weights: Vec<i16>,
    /// Columns of tables.
    pub tables: Vec<i64>,
}

/// The values of one sample.
#[derive(Clone)]
pub struct SampleValues {
    /// The relations of a statement about this sample alone.
    pub expert: Rc<Expert>,
    /// What is committed to.
    pub main: Vec<i64>,
    /// The sample.
    pub data: Vec<i64>,
    /// What is kept of the tree of its commitment, if that is known.
    pub kept: Option<Vec<crate::hash::SpongeDigest>>,
}

/// The samples that an argument is about. They are read one at a time.
pub trait Samples {
    /// The draw of each sample.
    fn draws(&self) -> Vec<&Draw>;

    /// A sample.
    ///
    /// # Errors
    /// It cannot be read.
    fn sample(&self, number: usize) -> io::Result<Cow<'_, Sample>>;

    /// What is kept of the tree of a sample's commitment, if it was committed to before.
    ///
    /// # Errors
    /// It cannot be read.
    fn kept(&self, _number: usize) -> io::Result<Option<Vec<crate::hash::SpongeDigest>>> {
        Ok(None)
    }
}

impl Samples for Vec<(Sample, Draw)> {
    fn draws(&self) -> Vec<&Draw> {
        self.iter().map(|(_, draw)| draw).collect()
    }

    fn sample(&self, number: usize) -> io::Result<Cow<'_, Sample>> {
        let own = self.get(number).map(|(sample, _)| Cow::Borrowed(sample));
        own.ok_or_else(|| io::ErrorKind::NotFound.into())
    }
}

fn read(samples: &impl Samples, number: usize) -> Result<Cow<'_, Sample>, Unprovable> {
    samples.sample(number).map_err(unreadable(number))
}

fn unreadable(sample: usize) -> impl Fn(io::Error) -> Unprovable {
    move |error| Unprovable::Sample {
        sample,
        reason: error.to_string(),
    }
}

/// Evaluates one of the models on a sample.
fn traced(
    spec: &EvalSpec,
    models: Models<'_>,
    model: usize,
    number: usize,
    (sample, draw): (&Sample, &Draw),
) -> Result<Traced, Unprovable> {
    let evaluator = Evaluator::new(spec).map_err(EvalError::from);
    let weights = models[model];
    let model = [Model::Base, Model::Update][model];
    let result = evaluator.and_then(|e| trace(&e, model, weights, sample, draw));
    result.map_err(|error| Unprovable::Evaluation {
        model,
        sample: number,
        error,
    })
}

/// Evaluates both models on a sample, side by side.
fn both_traced(
    spec: &EvalSpec,
    models: Models<'_>,
    number: usize,
    sample: (&Sample, &Draw),
) -> Result<[Traced; 2], Unprovable> {
    let traced = |model| traced(spec, models, model, number, sample);
    let (base, update) = rayon::join(|| traced(0), || traced(1));
    Ok([base?, update?])
}

/// What is stated about two models and samples in a context ([`Statement::context`]).
///
/// # Errors
/// A sample cannot be read, or the evaluation fails on it.
pub fn evaluate(
    context: Digest,
    spec: &EvalSpec,
    models: Models<'_>,
    samples: &impl Samples,
    tell: Tell<'_>,
) -> Result<Statement, Unprovable> {
    let (mut evaluated, mut saturates) = (vec![], false);
    let draws = samples.draws();
    for (number, draw) in draws.iter().enumerate() {
        let sample = read(samples, number)?;
        let both = both_traced(spec, models, number, (&sample, draw))?;
        saturates |= both.iter().any(|traced| traced.saturates);
        evaluated.push(EvaluatedSample {
            prefix: sample.prefix(),
            frames: frames(spec, &sample),
            draw: (*draw).clone(),
            losses: both.map(|traced| traced.loss.squared_error),
        });
        tell(Phase::Evaluating, (number + 1) as f64 / draws.len() as f64);
    }
    let layout = Layout::new(&spec.dims);
    let scales = |weights: &QuantisedWeights| {
        let tensors = 0..layout.tensors.len();
        tensors
            .map(|index| weights.tensor(&layout, index).1)
            .collect()
    };
    Ok(Statement {
        context,
        spec: spec.clone(),
        scales: models.map(scales),
        saturates,
        samples: evaluated,
    })
}

impl Common {
    /// The values of both models, and of all tables.
    pub fn new(statement: &Statement, models: Models<'_>) -> Self {
        let expert = Expert::new(&statement.of(None));
        let tensors = &expert.builder.relations.tensors;
        let layout = Layout::new(&statement.spec.dims);
        let mut weights = vec![0; length(&expert, WEIGHTS)];
        for matrices in &expert.weights {
            let tensor = &tensors[matrices.tensor];
            matrices.each(tensor, &layout, models, |number, value| {
                weights[number] = value
            });
        }
        let tables = columns(&expert, length(&expert, TABLES));
        Self { weights, tables }
    }

    /// The values of all sources, by number.
    pub fn sources<'a>(
        &'a self,
        main: SourceValues<'a>,
        data: SourceValues<'a>,
    ) -> [SourceValues<'a>; 4] {
        let (weights, tables) = (&self.weights, &self.tables);
        [
            main,
            data,
            SourceValues::Narrow(weights),
            SourceValues::Wide(tables),
        ]
    }
}

/// How many values a source has.
fn length(expert: &Expert, source: ColumnSource) -> usize {
    1 << expert.source_bits[source.0 as usize]
}

impl SampleValues {
    /// The values of all sources, by number.
    pub fn sources<'a>(&'a self, common: &'a Common) -> [SourceValues<'a>; 4] {
        common.sources(
            SourceValues::Wide(&self.main),
            SourceValues::Wide(&self.data),
        )
    }

    /// Computes all values of sample number `number`. They obey the relations, if the evaluation did not fail.
    ///
    /// The models are evaluated once more, so that nothing of an evaluation has to be kept until then.
    ///
    /// # Errors
    /// The sample cannot be read, or a value is beyond what the argument's tables hold.
    pub fn of(
        statement: &Statement,
        common: &Common,
        number: usize,
        models: Models<'_>,
        samples: &impl Samples,
    ) -> Result<Self, Unprovable> {
        let sample = &*read(samples, number)?;
        let draw = &statement.samples[number].draw;
        let kept = both_traced(&statement.spec, models, number, (sample, draw))?;
        let kept = kept.map(|traced| traced.kept);
        let statement = statement.of(Some(number));
        let expert = Expert::new(&statement);
        let relations = &expert.builder.relations;
        let sizes = &expert.builder.sizes;
        let mut data = vec![0; length(&expert, DATA)];
        let tensors = &relations.tensors;
        expert
            .sample
            .fill(&statement.spec, tensors, sample, &mut data);
        let mut filling = Filling {
            relations,
            main: vec![0; length(&expert, MAIN)],
            data: &data,
            weights: &common.weights,
            tables: &common.tables,
            computed: Computed::default(),
        };
        let hidden = &tensors[expert.given.hidden.tensor];
        for (model, kept) in kept.iter().enumerate() {
            fill_hidden(&statement, sizes, kept, model, hidden, &mut filling.main);
        }
        let of_hidden = |main: &[i64]| {
            let bits: u32 = hidden
                .places
                .iter()
                .map(|place| u32::from(place.bits))
                .sum();
            main[hidden.offset..][..1 << bits].to_vec()
        };
        let given = of_hidden(&filling.main);
        for step in &expert.builder.steps {
            step(&mut filling);
        }
        differs(hidden, &given, &of_hidden(&filling.main))?;
        filling.count()?;
        let main = filling.main;
        Ok(Self {
            expert: Rc::new(expert),
            main,
            data,
            kept: samples.kept(number).map_err(unreadable(number))?,
        })
    }
}

/// Fails with the first value of a tensor that the relations give and that was given otherwise.
fn differs(tensor: &Tensor, given: &[i64], filled: &[i64]) -> Result<(), Unprovable> {
    let pairs = given.iter().zip(filled);
    let first = pairs
        .enumerate()
        .find(|(_, (expected, found))| expected != found);
    first.map_or(Ok(()), |(index, (&expected, &found))| {
        Err(Unprovable::Differs {
            tensor: tensor.name,
            index: tensor.offset + index,
            expected,
            found,
        })
    })
}

/// The columns of tables.
fn columns(expert: &Expert, length: usize) -> Vec<i64> {
    let mut columns = vec![0; length];
    for (tensor, value) in tables(expert) {
        let rows = 1usize << tensor.places[0].bits;
        for (row, column) in columns[tensor.offset..][..rows].iter_mut().enumerate() {
            *column = value(row);
        }
    }
    columns
}

/// The residual stream after each layer.
fn fill_hidden(
    statement: &Statement,
    sizes: &Sizes,
    kept: &[LinearSums],
    model: usize,
    tensor: &Tensor,
    main: &mut [i64],
) {
    debug_assert_eq!((sizes.of(M), sizes.of(N)), (1, sizes.of(L) + 1));
    debug_assert_eq!(sizes.of(T), tensor.places[0].bits);
    let spec = &statement.spec;
    let width = spec.dims.expert_width as usize;
    let outputs = |index: usize| -> Vec<i64> {
        let own = kept.iter().filter(|(of, _)| *of == index);
        own.flat_map(|(_, sums)| sums)
            .map(|&sum| output(sum))
            .collect()
    };
    let add = |sums: Vec<i64>, residual: &[i64], from: u8, to: u8| -> Vec<i64> {
        let rescale = Rescale::new(from as i32, to as i32);
        let pairs = sums.iter().zip(residual);
        pairs
            .map(|(&sum, &residual)| saturated(sum + rescale.apply(residual)).into())
            .collect()
    };
    let mut hidden = outputs(EMBEDDED);
    let mut bits = spec.hidden;
    for (layer, scales) in spec.layers.iter().enumerate() {
        let first = first_of_layer(layer);
        let attended = add(outputs(first + place::OUT), &hidden, bits, scales.attended);
        let down = outputs(first + place::DOWN);
        hidden = add(down, &attended, scales.attended, scales.hidden);
        bits = scales.hidden;
        for (token, row) in hidden.chunks_exact(width).enumerate() {
            for (index, &value) in row.iter().enumerate() {
                let indices = [token, sizes.n(model, layer), index, 0];
                main[tensor.number(&indices)] = value;
            }
        }
    }
}
