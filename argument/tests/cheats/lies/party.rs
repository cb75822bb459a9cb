//! The argument of a prover that lies.

use super::fractions::{leaves, sum};
use super::opening::{do_work, open, Segment, Worlds};
use zk0_argument::expert::argument::Shape;
use zk0_argument::expert::builder::{DATA, MAIN};
use zk0_argument::expert::evaluation::layers::Expert;
use zk0_argument::expert::publics::number::LOSSES;
use zk0_argument::expert::sizes::S;
use zk0_argument::expert::statement::Statement;
use zk0_argument::expert::witness::Witness;
use zk0_argument::field::{Extension, Goldilocks};
use zk0_argument::fractions::LeafClaim;
use zk0_argument::protocol::{argue, Claim, Fold, Layout, Party, Sum, Weighted};
use zk0_argument::prove::{Computed, Proving, Tables, Values};
use zk0_argument::relation::{Atom, Part, Parts, Relations, Source};
use zk0_argument::share::share;
use zk0_argument::transcript::{Challenges, Prover, Refused};
use zk0_argument::tree::prove::Tree;

/// What the prover lies about. Up to [`Lie::Loss`] it argues about the truth but for the lie. From [`Lie::Claims`] on it argues about the
/// tale, until the step that the lie names.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Lie {
    /// Nothing. The argument is about the truth.
    Nothing,
    /// That a proof of work was done.
    Idle(&'static str),
    /// Zero is written as p in what is committed to.
    Zeros,
    /// One row of the first sample's codewords is another one.
    Beside,
    /// The sum of all fractions.
    Root,
    /// The numerators, so that the fractions are those of the tale.
    Numerators,
    /// Numerators and denominators.
    Leaves,
    /// The loss: it is said to be what is stated.
    Loss,
    /// The sums of products, and the fractions, which follow from them.
    Products,
    /// All claims about what was committed to, up to the sumcheck that is about all of them.
    Claims,
    /// The values at the point that this sumcheck leads to.
    Shared,
    /// The values of columns.
    OpenedValues,
    /// The random combination of columns.
    Combination,
    /// The rows that are opened.
    Rows,
    /// The values of columns, for which the last message makes up.
    LastMessage,
}

/// A prover of two worlds. The transcript is with the truth.
struct Liar<'a> {
    tale: Proving<'a>,
    truth: Proving<'a>,
    values: [&'a [Values<'a>]; 2],
    lie: Lie,
    /// All claims have been made one.
    shared: bool,
}

impl<'a> Liar<'a> {
    /// Argues about the tale, or else about the truth.
    fn tell<R>(&mut self, tale: bool, argue: impl FnOnce(&mut Proving<'a>) -> R) -> R {
        if !tale {
            return argue(&mut self.truth);
        }
        core::mem::swap(&mut self.tale.prover, &mut self.truth.prover);
        let result = argue(&mut self.tale);
        core::mem::swap(&mut self.tale.prover, &mut self.truth.prover);
        result
    }
}

impl Challenges for Liar<'_> {
    fn challenge(&mut self) -> Extension {
        self.truth.challenge()
    }

    fn positions(&mut self, count: usize, bits: u32) -> Vec<usize> {
        self.truth.positions(count, bits)
    }
}

impl Party for Liar<'_> {
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
                self.truth.prover.send_extension(&[stated]);
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
        do_work(&mut self.truth.prover, bits, what, self.lie);
        Ok(())
    }

    fn fractions(
        &mut self,
        relations: &Relations,
        layout: &Layout,
        fold: &Fold,
    ) -> Result<LeafClaim, Refused> {
        let [tale, truth] = self.values.map(|sources| {
            let computed = &Computed::default();
            let tables = Tables {
                relations,
                sources,
                computed,
            };
            leaves(&tables, layout, fold)
        });
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
        let liar = self.lie == Lie::Root;
        Ok(sum(&mut self.truth.prover, told, liar))
    }

    fn reduce(
        &mut self,
        relations: &Relations,
        parts: &Parts,
        sums: &[(Sum, Extension)],
        gamma: Extension,
        degree: usize,
    ) -> Result<(Vec<Extension>, Extension), Refused> {
        self.tell(self.lie >= Lie::Claims, |proving| {
            proving.reduce(relations, parts, sums, gamma, degree)
        })
    }

    fn reduce_claims(
        &mut self,
        parts: &Parts,
        sources: &[(Source, usize)],
        claims: &[Claim],
        gamma: Extension,
    ) -> Result<(Vec<Extension>, Extension), Refused> {
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

/// The segments of what is committed to.
fn segments(shape: &Shape, witness: &Witness) -> Vec<Segment> {
    let height = 1 << shape.parameters.variables();
    let mut segments = vec![];
    for (values, width) in [&witness.main, &witness.data].into_iter().zip(shape.widths) {
        for segment in values.chunks_exact(values.len() / shape.segments) {
            let columns = segment.chunks_exact(height).take(width);
            let elements = columns.map(|c| c.iter().map(|&v| Goldilocks::from_i64(v)).collect());
            segments.push(Segment::new(elements.collect()));
        }
    }
    segments
}

/// Argues for a statement. The worlds are the tale and the truth.
pub fn prove(
    statement: &Statement,
    expert: &Expert,
    [tale, truth]: [&Witness; 2],
    lie: Lie,
) -> Vec<u64> {
    let shape = Shape::new(expert).unwrap();
    let mut prover = Prover::new(&statement.digest());
    let [told, mut true_ones] = [tale, truth].map(|witness| segments(&shape, witness));
    if lie == Lie::Zeros {
        true_ones.iter_mut().for_each(Segment::with_p_for_zero);
    }
    if lie == Lie::Beside {
        true_ones[shape.segments].change_a_row();
    }
    let trees: Vec<Tree> = true_ones.iter().map(|s| s.commit(&mut prover)).collect();
    let values = [&tale.sources()[..], &truth.sources()[..]];
    let mut liar = Liar {
        tale: Proving::new(Prover::new(&statement.digest()), values[0].to_vec()),
        truth: Proving::new(prover, values[1].to_vec()),
        values,
        lie,
        shared: false,
    };
    let samples = expert.builder.sizes.of(S);
    let sources = [MAIN, DATA].map(|source| {
        let bits = expert.source_bits[source.0 as usize] + samples;
        (source, bits as usize)
    });
    let mut parts = Parts::default();
    // Where a check of both sides fails, the verifier gets no further either.
    if let Ok(mut claims) = argue(&mut liar, &expert.builder.relations, &mut parts) {
        claims.retain(|claim| [MAIN, DATA].contains(&claim.about.source));
        if let Ok((point, _)) = share(&mut liar, &mut parts, &sources, &claims) {
            let worlds = Worlds {
                trees: &trees,
                truth: &true_ones,
                tale: &told,
            };
            let point = &point[..shape.parameters.variables()];
            open(
                &mut liar.truth.prover,
                &shape.parameters,
                &worlds,
                point,
                lie,
            );
        }
    }
    liar.truth.prover.finish()
}
