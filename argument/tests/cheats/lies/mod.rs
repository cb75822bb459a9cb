//! A prover that lies once, and argues on honestly from its lie.
//!
//! It knows two worlds. In the *truth* are the values that it commits to and the weights that the statement is about. The *tale* is another
//! world, in which the statement holds. It states what is so in the tale up to a certain step, and what is so in truth from then on. So exactly
//! one check can notice: the one that ties both together. Where a test shows that the check refuses the lie, `testkit/tests/deletions/argument.rs`
//! removes the check from a copy of the sources, and there the lie is accepted.
//!
//! - [`party`]: the argument, with the step at which the worlds change. [`fractions`]: its sum of fractions, which is written anew, as simply as
//!   possible, so that any step can lie. A test compares it with the real one.
//!
//! Lies about what is opened are in `tests/commitment.rs`.
pub mod fractions;
pub mod party;

use crate::models::{Models, BLIND};
use party::Lie;
use std::io;
use zk0_argument::expert::argument::prove::{prove, unmet};
use zk0_argument::expert::argument::{verify, Verified};
use zk0_argument::expert::evaluation::layers::Expert;
use zk0_argument::expert::prover_values::{evaluate, Common, SampleValues};
use zk0_argument::expert::published::Published;
use zk0_argument::expert::statement::Statement;
use zk0_argument::prove::progress::silently;
use zk0_argument::prove::SourceValues;
use zk0_argument::transcript::{Prover, Refused};
use zk0_circuits::model::draw::Draw;
use zk0_circuits::model::layout::Layout;
use zk0_circuits::{Digest, EvalSpec, QuantisedWeights, Sample};

/// What the statements are about.
const CONTEXT: Digest = Digest([7; 32]);

/// Models and samples, what is stated about them, and all values behind it.
pub struct World {
    pub models: Models,
    pub statement: Statement,
    pub expert: Expert,
    pub known: Known,
}

/// All values behind a statement.
#[derive(Clone)]
pub struct Known {
    /// Those of both models and of tables.
    pub common: Common,
    /// Those of each sample.
    pub samples: Vec<SampleValues>,
}

impl Known {
    /// The values of all sources, for a statement about one sample.
    pub fn sources(&self) -> [SourceValues<'_>; 4] {
        self.samples[0].sources(&self.common)
    }
}

impl World {
    /// What these models make of these samples.
    pub fn of(models: Models) -> Self {
        let weights = [&models.base, &models.update];
        let statement =
            evaluate(CONTEXT, &models.spec, weights, &models.samples, &silently).unwrap();
        let expert = Expert::new(&statement);
        let known = known(&statement, weights, &models.samples);
        Self {
            models,
            statement,
            expert,
            known,
        }
    }

    /// Random models on random samples.
    pub fn random(samples: usize, seed: u64) -> Self {
        Self::of(Models::new(&EvalSpec::micro(), samples, seed))
    }

    /// The relations of what is stated now.
    pub fn state(&mut self) {
        self.expert = Expert::new(&self.statement);
    }

    /// An argument for what this world states, by a prover that tells of this world until its lie, and of `truth` from then on.
    pub fn prove(&self, truth: &Known, lie: Lie) -> Prover {
        party::prove(&self.statement, [&self.known, truth], lie)
    }

    /// What whoever holds these weights states of an argument for what this world states.
    pub fn verify(
        &self,
        weights: [&QuantisedWeights; 2],
        proof: &[u64],
    ) -> Result<Verified, Refused> {
        let verified = verify(&self.statement, proof)?;
        self.check(weights, &verified.published)?;
        Ok(verified)
    }

    /// Checks what an argument leaves to check.
    pub fn check(
        &self,
        weights: [&QuantisedWeights; 2],
        published: &Published,
    ) -> Result<(), Refused> {
        let layout = Layout::new(&self.statement.spec.dims);
        let sums = |model: usize| {
            let tensor = |number| Ok::<_, Refused>(weights[model].tensor(&layout, number).0);
            published.sums(&self.expert, model, layout.tensors.len(), tensor)
        };
        published.check(&self.expert, [&sums(0)?, &sums(1)?])
    }

    /// What the verifier states of this world's own weights and of an argument with this lie: nothing, where it is accepted.
    pub fn told(&self, truth: &Known, lie: Lie) -> Result<(), Refused> {
        let prover = self.prove(truth, lie);
        let weights = [&self.models.base, &self.models.update];
        self.named(&prover, self.verify(weights, prover.words()).map(drop))
    }

    /// What the verifier states of an honest argument that was changed.
    pub fn changed(&self, change: impl FnOnce(&mut Vec<u64>)) -> Result<(), Refused> {
        let mut proof = self.prove(&self.known, Lie::Nothing).finish()?;
        change(&mut proof);
        let weights = [&self.models.base, &self.models.update];
        self.verify(weights, &proof).map(drop)
    }

    /// What a verifier states, but with the name of the equation between secret values that does not hold. The verifier sees that one does not, and
    /// cannot see which.
    pub fn named(&self, prover: &Prover, told: Result<(), Refused>) -> Result<(), Refused> {
        match told {
            Err(Refused::Equation("the sumcheck of an argument's end")) => {
                let unmet = unmet(&self.statement, prover)?;
                Err(Refused::Equation(
                    unmet.expect("an equation that does not hold"),
                ))
            }
            told => told,
        }
    }
}

/// The refusal that names an equation.
pub fn refused(equation: &'static str) -> Result<(), Refused> {
    Err(Refused::Equation(equation))
}

/// All values behind a statement about these models and samples.
pub fn known(
    statement: &Statement,
    models: [&QuantisedWeights; 2],
    samples: &Vec<(Sample, Draw)>,
) -> Known {
    let common = Common::new(statement, models);
    let sample_values =
        |number| SampleValues::of(statement, &common, number, models, samples).unwrap();
    let samples = (0..samples.len()).map(sample_values).collect();
    Known { common, samples }
}

/// The real prover's argument.
pub fn honest(statement: &Statement, known: &Known) -> Vec<u64> {
    let sample_values = |number: usize| Ok::<_, io::Error>(known.samples[number].clone());
    prove(
        statement,
        &known.common,
        &BLIND,
        None,
        &silently,
        sample_values,
    )
    .unwrap()
}
