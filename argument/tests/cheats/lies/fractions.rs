//! A sum of fractions, layer by layer: the same words as `zk0_argument::fractions::prove` states, but for the lie.

use super::party::Lie;
use zk0_argument::field::{Extension, Goldilocks};
use zk0_argument::fractions::LeafClaim;
use zk0_argument::layout::LookupLayout;
use zk0_argument::multilinear::{bind, eq_table};
use zk0_argument::party::Fold;
use zk0_argument::prove::Tables;
use zk0_argument::relation::Count;
use zk0_argument::transcript::{Challenges, Prover};

/// Numerators and denominators.
pub type Fractions = (Vec<Extension>, Vec<Extension>);

/// The fractions of all look-ups.
pub fn leaves(tables: &Tables<'_>, layout: &LookupLayout, fold: &Fold) -> Fractions {
    let relations = tables.relations;
    let mut numerators = vec![Extension::ZERO; 1 << layout.variables];
    let mut denominators = vec![Extension::ONE; 1 << layout.variables];
    let element = Goldilocks::from_i64;
    for (lookup, &offset) in relations.lookups.iter().zip(&layout.offsets) {
        let size = 1 << relations.size(&lookup.axes);
        let own = &mut denominators[offset..][..size];
        own.fill(fold.shift);
        for (&power, column) in fold.powers.iter().zip(&lookup.entry) {
            for (own, value) in own.iter_mut().zip(tables.linear(column, &lookup.axes)) {
                *own -= power.scale(element(value));
            }
        }
        let counts = match lookup.count {
            Count::Each => vec![1; size],
            Count::Masked(public) => tables.public(public, &lookup.axes),
            Count::Offered(counts) => {
                let counts = tables.of_virtual(counts, &lookup.axes);
                counts.iter().map(|count| -count).collect()
            }
        };
        for (own, count) in numerators[offset..].iter_mut().zip(counts) {
            *own = element(count).into();
        }
    }
    (numerators, denominators)
}

/// The sums of two fractions each.
fn parents((numerators, denominators): &Fractions) -> Fractions {
    let pairs = numerators.chunks(2).zip(denominators.chunks(2));
    pairs
        .map(|(p, q)| (p[0] * q[1] + p[1] * q[0], q[0] * q[1]))
        .unzip()
}

/// p0·q1 + p1·q0 + λ·q0·q1.
fn summand([p0, p1, q0, q1]: [Extension; 4], lambda: Extension) -> Extension {
    p0 * q1 + p1 * q0 + lambda * q0 * q1
}

/// Argues that the fractions add up to zero. A liar states it of the highest two fractions, whatever they are.
pub fn sum(prover: &mut Prover, leaves: Fractions, lie: Lie) -> LeafClaim {
    let mut layers = vec![leaves];
    while layers[layers.len() - 1].0.len() > 2 {
        layers.push(parents(&layers[layers.len() - 1]));
    }
    let (p, q) = layers.pop().unwrap();
    let mut children = [p[0], p[1], q[0], q[1]];
    if lie == Lie::Root {
        children[1] = -children[0] * children[3] * children[2].inverse();
    }
    prover.send_secret(&children);
    let denominator = children[2] * children[3];
    prover.send_secret(&[denominator, denominator.inverse()]);
    let mut point = vec![];
    loop {
        let step = prover.challenge();
        let between = |zero: Extension, one: Extension| zero + step * (one - zero);
        let [p0, p1, q0, q1] = children;
        let (numerator, denominator) = (between(p0, p1), between(q0, q1));
        point.insert(0, step);
        let Some((p, q)) = layers.pop() else {
            return LeafClaim {
                point,
                numerator,
                denominator,
            };
        };
        let lambda = prover.challenge();
        let mut claim = numerator + lambda * denominator;
        let every_second = |values: &[Extension], first: usize| -> Vec<Extension> {
            values.iter().copied().skip(first).step_by(2).collect()
        };
        let mut tables =
            [(&p, 0), (&p, 1), (&q, 0), (&q, 1)].map(|(values, first)| every_second(values, first));
        let mut next = vec![];
        for (number, &coordinate) in point.iter().enumerate() {
            let (mut constant, mut square) = (Extension::ZERO, Extension::ZERO);
            let weights = eq_table(&point[number + 1..]);
            for (pair, &weight) in weights.iter().enumerate() {
                let at = |table: usize, one: usize| tables[table][2 * pair + one];
                let zero = [0, 1, 2, 3].map(|table| at(table, 0));
                let difference = [0, 1, 2, 3].map(|table| at(table, 1) - at(table, 0));
                constant += weight * summand(zero, lambda);
                square += weight * summand(difference, lambda);
            }
            let slope = (claim - constant) * coordinate.inverse();
            prover.send_secret(&[slope, square]);
            let challenge = prover.challenge();
            claim = constant + challenge * (slope - square + challenge * square);
            next.push(challenge);
            tables.iter_mut().for_each(|table| bind(table, challenge));
        }
        point = next;
        children = tables.map(|table| table[0]);
        prover.send_secret(&children);
    }
}
