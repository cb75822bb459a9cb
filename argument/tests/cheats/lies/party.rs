//! The argument of a prover that lies.

use super::fractions::{leaves, sum, Fractions};
use super::Known;
use crate::models::BLIND;
use std::io;
use zk0_argument::expert::argument::prove::{prove_with, Hidden};
use zk0_argument::expert::argument::{argued, Shape};
use zk0_argument::expert::evaluation::layers::Expert;
use zk0_argument::expert::publics::number::LOSSES;
use zk0_argument::expert::statement::Statement;
use zk0_argument::field::Extension;
use zk0_argument::fractions::LeafClaim;
use zk0_argument::layout::LookupLayout;
use zk0_argument::multilinear::evaluate_extension;
use zk0_argument::party::{Fold, Party, Sources, Sum, ValueClaim, Weighted};
use zk0_argument::prove::progress::silently;
use zk0_argument::prove::{Computed, Instance, Proving, SourceValues, Tables};
use zk0_argument::relation::{Atom, Part, Parts, Relations};
use zk0_argument::sumcheck::JoinedPoint;
use zk0_argument::transcript::{Challenges, Pads, Prover, Refused};

/// What the prover lies about. Up to [`Lie::Loss`] it argues about the truth but for the lie. From [`Lie::Claims`] on it argues about the
/// tale, until the step that the lie names.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Lie {
    /// Nothing. The argument is about the truth.
    Nothing,
    /// The sum of all fractions.
    Root,
    /// The numerators, so that the fractions are those of the tale.
    Numerators,
    /// Numerators and denominators.
    Leaves,
    /// Numerators and denominators of all samples, up to the point that all go to.
    Gathered,
    /// The loss: it is stated to be what is stated.
    Loss,
    /// The sums of products, and the fractions, which follow from them.
    Products,
    /// All claims about what was committed to, up to the sumcheck that is about all of them.
    Claims,
    /// The values at the point that this sumcheck leads to.
    Shared,
}

/// A prover of two worlds. The transcript is with the truth.
struct Liar<'a, 'p> {
    tale: Proving<'a>,
    truth: &'a mut Proving<'p>,
    known: [&'a Known; 2],
    /// What all sums of fractions go to a point with.
    fold: Option<Fold>,
    point: Vec<Extension>,
    lie: Lie,
    /// All claims have been made one.
    shared: bool,
}

impl Liar<'_, '_> {
    /// Argues about the tale, or else about the truth.
    fn tell<R>(&mut self, tale: bool, argue: impl FnOnce(&mut Proving<'_>) -> R) -> R {
        if !tale {
            return argue(self.truth);
        }
        core::mem::swap(&mut self.tale.prover, &mut self.truth.prover);
        let result = argue(&mut self.tale);
        core::mem::swap(&mut self.tale.prover, &mut self.truth.prover);
        result
    }

    /// The fractions of an instance in the tale, which is world 0, or in truth.
    fn leaves(
        &self,
        world: usize,
        instance: usize,
        layout: &LookupLayout,
        fold: &Fold,
    ) -> Fractions {
        let known = self.known[world];
        let sample = &known.samples[instance];
        let tables = Tables {
            relations: &sample.expert.builder.relations,
            sources: &sample.sources(&known.common),
            computed: &Computed::default(),
        };
        leaves(&tables, layout, fold)
    }
}

impl Challenges for Liar<'_, '_> {
    fn challenge(&mut self) -> Extension {
        self.truth.challenge()
    }

    fn positions(&mut self, count: usize, bits: u32) -> Vec<usize> {
        self.truth.positions(count, bits)
    }
}

impl Party for Liar<'_, '_> {
    type Value = Extension;

    fn nothing(&mut self, about: &Weighted) -> Extension {
        self.tale.nothing(about);
        self.truth.nothing(about)
    }

    fn product(&mut self, a: &Extension, b: &Extension) -> Result<Extension, Refused> {
        Ok(*a * *b)
    }

    fn zero(&mut self, _: &'static str, _: Extension) -> Result<(), Refused> {
        Ok(())
    }

    fn published(&mut self, parts: &Parts, about: &Weighted) -> Result<Extension, Refused> {
        self.tell(self.lie >= Lie::Claims, |proving| {
            proving.published(parts, about)
        })
    }

    fn value(&mut self, parts: &Parts, about: &Weighted) -> Result<Extension, Refused> {
        let until = if self.shared {
            Lie::Shared
        } else {
            Lie::Claims
        };
        self.tell(self.lie >= until, |proving| proving.value(parts, about))
    }

    fn sum(
        &mut self,
        relations: &Relations,
        parts: &Parts,
        sum: &Sum,
    ) -> Result<Extension, Refused> {
        match sum {
            Sum::Monomials(number, weights)
                if self.lie == Lie::Loss && is_loss(relations, *number) =>
            {
                let parts: Vec<&Part> = weights.iter().map(|(_, id)| parts.get(*id)).collect();
                let stated = relations.publics[LOSSES].at(&parts);
                self.truth.prover.send_secret(&[stated]);
                Ok(stated)
            }
            Sum::Product(..) if self.lie == Lie::Products => {
                self.tell(true, |proving| proving.sum(relations, parts, sum))
            }
            _ => self.tell(self.lie >= Lie::Claims, |proving| {
                proving.sum(relations, parts, sum)
            }),
        }
    }

    fn work(&mut self, bits: u32, what: &'static str) -> Result<(), Refused> {
        self.truth.work(bits, what)
    }

    fn fractions(
        &mut self,
        instance: usize,
        layout: &LookupLayout,
        fold: &Fold,
    ) -> Result<LeafClaim, Refused> {
        if self.known[0].samples.len() > 1 {
            let tale = self.lie >= Lie::Gathered;
            return self.tell(tale, |proving| proving.fractions(instance, layout, fold));
        }
        let [tale, truth] = [0, 1].map(|world| self.leaves(world, instance, layout, fold));
        let told = match self.lie {
            Lie::Numerators => {
                let terms = tale.0.iter().zip(&tale.1).zip(&truth.1);
                let numerators = terms.map(|((&p, &q), &truth)| p * q.inverse() * truth);
                (numerators.collect(), truth.1)
            }
            // Sums of products are part of the entries.
            lie if lie == Lie::Leaves || lie >= Lie::Products => tale,
            _ => truth,
        };
        Ok(sum(&mut self.truth.prover, told, self.lie))
    }

    fn gather(
        &mut self,
        layout: &LookupLayout,
        fold: &Fold,
        claims: &[LeafClaim],
        gamma: Extension,
    ) -> Result<(Vec<Extension>, Extension), Refused> {
        let tale = self.lie >= Lie::Gathered;
        let gathered = self.tell(tale, |proving| proving.gather(layout, fold, claims, gamma))?;
        self.fold = Some(*fold);
        self.point = gathered.0.clone();
        Ok(gathered)
    }

    fn gathered(&mut self, count: usize) -> Result<Vec<[Extension; 2]>, Refused> {
        let (Lie::Gathered, Some(fold)) = (self.lie, self.fold) else {
            let tale = self.lie >= Lie::Gathered;
            return self.tell(tale, |proving| proving.gathered(count));
        };
        let values = (0..count).map(|instance| {
            let layout =
                LookupLayout::new(&self.known[1].samples[instance].expert.builder.relations);
            let (numerators, denominators) = self.leaves(1, instance, &layout, &fold);
            [numerators, denominators].map(|values| evaluate_extension(&values, &self.point))
        });
        let values: Vec<[Extension; 2]> = values.collect();
        self.truth.prover.send_secret(values.as_flattened());
        Ok(values)
    }

    fn reduce(
        &mut self,
        relations: &Relations,
        parts: &Parts,
        sums: &[(Sum, Extension)],
        gamma: Extension,
        degree: usize,
    ) -> Result<(JoinedPoint, Extension), Refused> {
        self.tell(self.lie >= Lie::Claims, |proving| {
            proving.reduce(relations, parts, sums, gamma, degree)
        })
    }

    fn reduce_claims(
        &mut self,
        parts: &Parts,
        sources: &Sources<'_>,
        claims: &[ValueClaim],
        gamma: Extension,
    ) -> Result<(JoinedPoint, Extension), Refused> {
        self.shared = true;
        self.tell(self.lie >= Lie::Shared, |proving| {
            proving.reduce_claims(parts, sources, claims, gamma)
        })
    }
}

/// Whether monomials are the sums of squared errors.
fn is_loss(relations: &Relations, number: usize) -> bool {
    let mut equalities = relations.equalities.iter();
    let loss = equalities.find(|equality| equality.name == "the loss");
    let mut terms = loss.unwrap().linear.iter();
    terms.any(|term| matches!(term.atom, Atom::Monomials(of) if of == number))
}

/// All instances of a world.
fn instances<'a>(known: &'a Known, nothing: &'a Expert) -> Vec<Instance<'a>> {
    let count = known.samples.len();
    let all = (0..count.next_power_of_two()).map(|number| {
        let sample = known.samples.get(number);
        let (relations, sources) = match sample {
            Some(sample) => (
                &sample.expert.builder.relations,
                sample.sources(&known.common),
            ),
            None => {
                let zero = || SourceValues::Wide(&[]);
                (
                    &nothing.builder.relations,
                    known.common.sources(zero(), zero()),
                )
            }
        };
        Instance {
            relations,
            sources: sources.to_vec(),
        }
    });
    all.collect()
}

/// Argues for a statement. The worlds are the tale and the truth.
pub fn prove(statement: &Statement, known: [&Known; 2], lie: Lie) -> Prover {
    let [tale, truth] = known;
    let hidden = Hidden {
        argument: Box::new(BLIND.of_argument(&statement.digest()).unwrap()),
        sample: &|_, values| Box::new(BLIND.of_sample(values)),
        deaf: false,
    };
    let nothing = Expert::new(&statement.of(None));
    let lying = |proving: &mut Proving<'_>, expert: &Expert, shape: &Shape| {
        let silent = Prover::new(&statement.digest(), Pads::new(vec![]));
        let mut liar = Liar {
            tale: Proving::new(silent, instances(tale, &nothing), shape.samples, &silently),
            truth: proving,
            known,
            fold: None,
            point: vec![],
            lie,
            shared: false,
        };
        argued(&mut liar, expert, shape)
    };
    let sample_values = |number: usize| Ok::<_, io::Error>(truth.samples[number].clone());
    let common = &truth.common;
    prove_with(
        statement,
        common,
        hidden,
        None,
        &silently,
        sample_values,
        lying,
    )
    .unwrap()
}
