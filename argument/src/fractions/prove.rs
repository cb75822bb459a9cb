//! The prover's side of a sum of fractions.
//!
//! Beside the leaves, it needs as much memory as the first layer above them would: 32 bytes for two leaves. A layer is freed as soon as the
//! first variable of its sumcheck is bound. The other rounds bind a variable and compute what is stated next in one pass.

pub mod halves;

use super::{Children, LeafClaim};
use crate::field::lazy::{LazyFactor, LazySum};
use crate::field::{Extension, Goldilocks};
use crate::multilinear::eq_table;
use crate::transcript::{Challenges, Prover};
use rayon::prelude::*;

use super::leaves::{FractionBuffer, Parents, Pieces};
pub use super::leaves::{Leaves, Numerator, StoredFractions};

/// Proves that Σ numerators/denominators = 0, over 2^n ≥ 2 fractions.
pub fn sum(
    prover: &mut Prover,
    mut numerators: Vec<Extension>,
    mut denominators: Vec<Extension>,
) -> LeafClaim {
    let variables = numerators.len().ilog2() as usize;
    let fractions = numerators.iter().zip(&denominators);
    let padding = fractions
        .rev()
        .take_while(|(&p, &q)| p == Extension::ZERO && q == Extension::ONE);
    let used = numerators.len() - padding.count();
    numerators.truncate(used);
    denominators.truncate(used);
    if numerators.par_iter().any(|p| p.0[1] != Goldilocks::ZERO) {
        return sum_of(
            prover,
            variables,
            StoredFractions::new(numerators, denominators),
        );
    }
    let numerators: Vec<Goldilocks> = numerators.into_par_iter().map(|p| p.0[0]).collect();
    sum_of(
        prover,
        variables,
        StoredFractions::new(numerators, denominators),
    )
}

/// Proves that 2^`variables` ≥ 2 fractions add up to zero.
pub fn sum_of(prover: &mut Prover, variables: usize, leaves: impl Leaves) -> LeafClaim {
    // The layers of 2, 4, … fractions. The one above the leaves is as large as all others together: it is not kept.
    let mut layers: Vec<Pieces> = Vec::with_capacity(variables);
    let above = Parents(&leaves);
    for _ in 2..variables {
        let next = match layers.last() {
            Some(layer) => Pieces::parents(layer),
            None => Pieces::parents(&above),
        };
        layers.push(next);
    }
    let mut children = match (layers.pop(), variables) {
        (Some(top), _) => top_of(&top),
        (None, 2) => top_of(&above),
        (None, _) => top_of(&leaves),
    };
    send(prover, &children);
    let denominator = children.q[0] * children.q[1];
    prover.send_secret(&[denominator, denominator.inverse()]);
    let mut point: Vec<Extension> = Vec::new();
    loop {
        let step = prover.challenge();
        let [numerator, denominator] = children.between(step);
        let claim = (numerator, denominator);
        point.insert(0, step);
        (point, children) = match (layers.pop(), variables - point.len()) {
            (Some(layer), _) => prove_layer(prover, layer, &point, claim),
            (None, 0) => {
                return LeafClaim {
                    point,
                    numerator,
                    denominator,
                }
            }
            (None, 1) => prove_layer(prover, &leaves, &point, claim),
            (None, _) => prove_layer(prover, &above, &point, claim),
        };
    }
}

fn send(prover: &mut Prover, children: &Children<Extension>) {
    let Children { p, q } = children;
    prover.send_secret(&[p[0], p[1], q[0], q[1]]);
}

fn top_of(leaves: &impl Leaves) -> Children<Extension> {
    let mut block = FractionBuffer::default();
    let (p, q) = block.read(leaves, 0, 2);
    Children {
        p: [p[0].extension(), p[1].extension()],
        q: [q[0], q[1]],
    }
}

/// What a sumcheck is about at one place: the summand is p0·q1 + q0·mixed, where `mixed` is p1 + λ·q1.
#[derive(Clone, Copy)]
struct Summand<N> {
    p0: N,
    q0: Extension,
    q1: Extension,
    mixed: Extension,
}

impl<N: Numerator> Summand<N> {
    /// From the fractions 2x and 2x + 1.
    #[inline(always)]
    fn of(p: &[N], q: &[Extension], lambda: &LazyFactor) -> Self {
        Self {
            p0: p[0],
            q0: q[0],
            q1: q[1],
            mixed: lambda.times_plus(q[1], p[1].extension()),
        }
    }

    #[inline(always)]
    fn summand(self) -> Extension {
        let mut sum = LazySum::default();
        self.p0.add_to(&mut sum, self.q1);
        sum.add(self.q0, self.mixed);
        sum.reduce()
    }

    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        Self {
            p0: self.p0.minus(other.p0),
            q0: self.q0 - other.q0,
            q1: self.q1 - other.q1,
            mixed: self.mixed - other.mixed,
        }
    }
}

impl Summand<Extension> {
    #[inline(always)]
    fn between(factor: &LazyFactor, zero: &Self, one: &Self) -> Self {
        Self {
            p0: factor.between(zero.p0, one.p0),
            q0: factor.between(zero.q0, one.q0),
            q1: factor.between(zero.q1, one.q1),
            mixed: factor.between(zero.mixed, one.mixed),
        }
    }
}

/// The places of all pairs in use, in pieces of as many as one table of weights is for.
type Summands = Vec<Vec<Summand<Extension>>>;

/// A sum with weights over pairs of places: the constant and the leading coefficient of the round polynomial.
#[derive(Clone, Copy, Default)]
struct RoundPolynomial {
    constant: LazySum,
    square: LazySum,
}

impl RoundPolynomial {
    #[inline(always)]
    fn add<N: Numerator>(&mut self, weight: Extension, zero: Summand<N>, one: Summand<N>) {
        self.constant.add(weight, zero.summand());
        self.square.add(weight, one.minus(zero).summand());
    }

    fn times(self, weight: Extension) -> [Extension; 2] {
        [self.constant, self.square].map(|sum| weight * sum.reduce())
    }
}

/// Variables whose weights are in one table.
const LOW: usize = 9;

/// eq of a point and the numbers of pairs: the product of two tables.
struct PairWeights {
    low: Vec<Extension>,
    high: Vec<Extension>,
    /// The sum of the weights of pairs that are not in use.
    unused: Extension,
}

impl PairWeights {
    fn new(point: &[Extension], used: usize) -> Self {
        let (low, high) = point.split_at(point.len().min(LOW));
        Self {
            low: eq_table(low),
            high: eq_table(high),
            unused: Extension::ONE - eq_below(point, used),
        }
    }

    fn blocks(&self, pairs: usize) -> usize {
        pairs.div_ceil(self.low.len())
    }
}

/// Σ eq(point, x) for x below `count`.
fn eq_below(point: &[Extension], count: usize) -> Extension {
    let mut sum = Extension::ZERO;
    let mut prefix = Extension::ONE;
    let mut rest = count;
    for (variable, &coordinate) in point.iter().enumerate().rev() {
        let one = prefix * coordinate;
        match rest >> variable {
            0 => prefix -= one,
            1 => {
                sum += prefix - one;
                prefix = one;
                rest -= 1 << variable;
            }
            _ => return Extension::ONE,
        }
    }
    match rest {
        0 => sum,
        _ => sum + prefix,
    }
}

fn add(a: [Extension; 2], b: [Extension; 2]) -> [Extension; 2] {
    [a[0] + b[0], a[1] + b[1]]
}

/// A layer's sumcheck in progress.
struct LayerSumcheck {
    lambda: LazyFactor,
    /// The summand where both fractions are 0/1.
    padding: Extension,
}

impl LayerSumcheck {
    /// The first round polynomial.
    fn first<L: Leaves>(&self, leaves: &L, point: &[Extension]) -> [Extension; 2] {
        let pairs = leaves.len().div_ceil(4);
        let weights = PairWeights::new(point, pairs);
        let size = weights.low.len();
        let blocks = (0..weights.blocks(pairs)).into_par_iter();
        let sums = blocks.map_init(FractionBuffer::default, |block, number| {
            let first = number * size;
            let (p, q) = block.read(leaves, 4 * first, 4 * size.min(pairs - first));
            let fractions = p.as_chunks::<4>().0.iter().zip(q.as_chunks::<4>().0);
            let mut round = RoundPolynomial::default();
            for ((p, q), &weight) in fractions.zip(&weights.low) {
                let place = |at: usize| Summand::of(&p[at..at + 2], &q[at..at + 2], &self.lambda);
                round.add(weight, place(0), place(2));
            }
            round.times(weights.high[number])
        });
        self.padded(sums.reduce(Default::default, add), &weights)
    }

    /// Binds the first variable, and computes the next round polynomial.
    fn second<L: Leaves>(
        &self,
        leaves: &L,
        challenge: &LazyFactor,
        point: &[Extension],
    ) -> (Summands, [Extension; 2]) {
        let pairs = leaves.len().div_ceil(8);
        let weights = PairWeights::new(point, pairs);
        let size = weights.low.len();
        let blocks = (0..weights.blocks(pairs)).into_par_iter();
        let blocks = blocks.map_init(FractionBuffer::default, |block, number| {
            let first = number * size;
            let (p, q) = block.read(leaves, 8 * first, 8 * size.min(pairs - first));
            let fractions = p.as_chunks().0.iter().zip(q.as_chunks().0);
            let places = fractions.map(|(p, q)| self.bound(p, q, challenge));
            let places: Vec<Summand<Extension>> = places.collect();
            let sums = round(&places, &weights.low).times(weights.high[number]);
            (places, sums)
        });
        let (places, sums): (Summands, Vec<_>) = blocks.unzip();
        (
            places,
            self.padded(sums.into_iter().fold(Default::default(), add), &weights),
        )
    }

    /// Binds the next variable, and computes the round polynomial after it.
    fn next(
        &self,
        places: &mut Summands,
        challenge: &LazyFactor,
        point: &[Extension],
    ) -> [Extension; 2] {
        let pad = |places: &mut Vec<Summand<Extension>>, multiple: usize| {
            places.resize(places.len().next_multiple_of(multiple), self.place());
        };
        let used: usize = places.iter().map(Vec::len).sum();
        let pairs = used.div_ceil(4);
        let weights = PairWeights::new(point, pairs);
        let blocks = places.par_chunks_mut(2).zip(&weights.high);
        let sums = blocks.map(|(pieces, &weight)| {
            let [bound, rest @ ..] = pieces else {
                return Default::default();
            };
            pad(bound, 2);
            for at in 0..bound.len() / 2 {
                bound[at] = Summand::between(challenge, &bound[2 * at], &bound[2 * at + 1]);
            }
            bound.truncate(bound.len() / 2);
            for piece in rest.iter_mut().map(core::mem::take) {
                let pairs = piece.chunks(2);
                bound.extend(pairs.map(|pair| {
                    let one = pair.get(1).copied().unwrap_or(self.place());
                    Summand::between(challenge, &pair[0], &one)
                }));
            }
            pad(bound, 2);
            round(bound, &weights.low).times(weight)
        });
        let sums = self.padded(sums.reduce(Default::default, add), &weights);
        places.retain(|piece| !piece.is_empty());
        sums
    }

    /// What four fractions become when the first variable is bound.
    #[inline(always)]
    fn bound<N: Numerator>(
        &self,
        p: &[N; 4],
        q: &[Extension; 4],
        challenge: &LazyFactor,
    ) -> Summand<Extension> {
        let numerators = [0, 1].map(|at| N::between(challenge, p[at], p[at + 2]));
        let denominators = [0, 1].map(|at| challenge.between(q[at], q[at + 2]));
        Summand::of(&numerators, &denominators, &self.lambda)
    }

    /// A place where both fractions are 0/1.
    fn place(&self) -> Summand<Extension> {
        Summand {
            p0: Extension::ZERO,
            q0: Extension::ONE,
            q1: Extension::ONE,
            mixed: self.padding,
        }
    }

    fn padded(&self, [constant, square]: [Extension; 2], weights: &PairWeights) -> [Extension; 2] {
        [constant + self.padding * weights.unused, square]
    }
}

fn round(places: &[Summand<Extension>], weights: &[Extension]) -> RoundPolynomial {
    let mut round = RoundPolynomial::default();
    for (&[zero, one], &weight) in places.as_chunks().0.iter().zip(weights) {
        round.add(weight, zero, one);
    }
    round
}

/// One layer's sumcheck, of the claim about numerator and denominator at a point. Returns its point, and the four values there, which are
/// stated.
fn prove_layer<L: Leaves>(
    prover: &mut Prover,
    leaves: L,
    claimed_at: &[Extension],
    (numerator, denominator): (Extension, Extension),
) -> (Vec<Extension>, Children<Extension>) {
    let lambda = prover.challenge();
    let mut claim = numerator + lambda * denominator;
    let layer = LayerSumcheck {
        lambda: LazyFactor::new(lambda),
        padding: lambda,
    };
    let mut point = Vec::with_capacity(claimed_at.len() + 1);
    let mut say = |coordinate: Extension, [constant, square]: [Extension; 2]| {
        // The claim is constant + coordinate·slope. That the coordinate is 0 has a probability of 2^-128.
        let slope = (claim - constant) * coordinate.inverse();
        prover.send_secret(&[slope, square]);
        let challenge = prover.challenge();
        claim = constant + challenge * (slope - square + challenge * square);
        point.push(challenge);
        LazyFactor::new(challenge)
    };
    let mut challenge = say(claimed_at[0], layer.first(&leaves, &claimed_at[1..]));
    let last = match claimed_at.len() {
        1 => {
            let mut block = FractionBuffer::default();
            let (p, q) = block.read(&leaves, 0, 4);
            layer.bound(
                &[p[0], p[1], p[2], p[3]],
                &[q[0], q[1], q[2], q[3]],
                &challenge,
            )
        }
        _ => {
            let (mut places, mut sums) = layer.second(&leaves, &challenge, &claimed_at[2..]);
            drop(leaves);
            for round in 1..claimed_at.len() - 1 {
                challenge = say(claimed_at[round], sums);
                sums = layer.next(&mut places, &challenge, &claimed_at[round + 2..]);
            }
            challenge = say(claimed_at[claimed_at.len() - 1], sums);
            let mut places = places.into_iter().flatten();
            let [zero, one] = [0, 1].map(|_| places.next().unwrap_or(layer.place()));
            Summand::between(&challenge, &zero, &one)
        }
    };
    let Summand { p0, q0, q1, mixed } = last;
    let children = Children {
        p: [p0, mixed - lambda * q1],
        q: [q0, q1],
    };
    send(prover, &children);
    (point, children)
}
