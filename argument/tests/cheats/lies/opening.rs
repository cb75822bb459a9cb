//! Commitments and their opening: the same words as `zk0_argument::commitment::prove` says, but for the lie.

use super::party::Lie;
use bytemuck::TransparentWrapper;
use zk0_argument::commitment::parameters::{cap_bits, CAP, FOLDS, LAST, SIBLINGS, WORK};
use zk0_argument::commitment::{Parameters, Rate};
use zk0_argument::field::goldilocks::P;
use zk0_argument::field::{Extension, Goldilocks};
use zk0_argument::multilinear::{bind, eq_table, evaluate};
use zk0_argument::transcript::{work, Challenges, Prover};
use zk0_argument::tree::prove::Tree;

/// Of what is committed to: the rate of the code of an expert's argument, and its queries.
pub const RATE: Rate = Rate::Quarter;
pub const QUERIES: usize = 127;

/// Values of one segment, with their codewords.
pub struct Segment {
    columns: Vec<Vec<Goldilocks>>,
    /// By rows.
    codewords: Vec<Goldilocks>,
}

impl Segment {
    /// Of columns of equal length.
    pub fn new(columns: Vec<Vec<Goldilocks>>) -> Self {
        let encoded = columns.iter().map(|column| {
            let column: Vec<Extension> = column.iter().map(|&value| value.into()).collect();
            encode(&column)
        });
        let encoded: Vec<Vec<Extension>> = encoded.collect();
        let rows = 0..encoded[0].len();
        Self {
            codewords: rows
                .flat_map(|row| encoded.iter().map(move |codeword| codeword[row].0[0]))
                .collect(),
            columns,
        }
    }

    /// Writes zero as p, which is the same element.
    pub fn with_p_for_zero(&mut self) {
        for value in &mut self.codewords {
            if *value == Goldilocks::ZERO {
                *value = Goldilocks::wrap(P);
            }
        }
    }

    /// Changes one row, which is hardly ever opened.
    pub fn change_a_row(&mut self) {
        self.codewords[0] += Goldilocks::ONE;
    }

    fn row(&self, position: usize) -> &[Goldilocks] {
        let width = self.columns.len();
        &self.codewords[position * width..][..width]
    }

    /// Says the cap of the codewords' tree.
    pub fn commit(&self, prover: &mut Prover) -> Tree {
        let width = self.columns.len();
        let tree = Tree::new(self.codewords.len() / width, width, CAP, |row, column| {
            self.codewords[row * width + column].value()
        });
        tree.send_cap(prover);
        tree
    }
}

/// What was committed to, and what is told of in its place.
pub struct Worlds<'a> {
    pub trees: &'a [Tree],
    pub truth: &'a [Segment],
    pub tale: &'a [Segment],
}

/// Opens all columns at a point.
pub fn open(
    prover: &mut Prover,
    parameters: &Parameters,
    worlds: &Worlds<'_>,
    point: &[Extension],
    lie: Lie,
) {
    // The values, the combination of all columns, and the rows may be those of the tale.
    let of = |last: Lie| match (Lie::OpenedValues..=Lie::Rows).contains(&lie) && lie >= last {
        true => worlds.tale,
        false => worlds.truth,
    };
    let columns = |segments: &'_ [Segment]| -> Vec<Vec<Goldilocks>> {
        let columns = segments.iter().flat_map(|segment| segment.columns.clone());
        columns.collect()
    };
    // Who lies in the last message lies about the values, too, for which the message makes up.
    let said = match lie {
        Lie::LastMessage => worlds.tale,
        _ => of(Lie::OpenedValues),
    };
    let said: Vec<Extension> = columns(said).iter().map(|c| evaluate(c, point)).collect();
    prover.send_extension(&said);
    do_work(prover, WORK, "the combination of columns", lie);
    let variables = said.len().next_power_of_two().ilog2() as usize;
    let weights = eq_table(&prover.challenges(variables));

    let mut claim = sum(&weights, &said);
    let mut message = vec![Extension::ZERO; 1 << parameters.variables()];
    for (column, &weight) in columns(of(Lie::Combination)).iter().zip(&weights) {
        for (sum, &value) in message.iter_mut().zip(column) {
            *sum += weight.scale(value);
        }
    }
    let mut committed = vec![];
    let mut bound = 0;
    while bound < parameters.variables() - LAST as usize {
        let codeword = encode(&message);
        let count = codeword.len() / SIBLINGS;
        let element = |leaf: usize, coefficient: usize| {
            codeword[leaf + coefficient / 2 * count].0[coefficient % 2].value()
        };
        let tree = Tree::new(count, 2 * SIBLINGS, cap_bits(count.ilog2()), element);
        tree.send_cap(prover);
        for _ in 0..FOLDS {
            let pairs = message.as_chunks::<2>().0.iter();
            let slopes: Vec<Extension> = pairs.map(|[zero, one]| *one - *zero).collect();
            let slope = sum(&eq_table(&point[bound + 1..]), &slopes);
            prover.send_extension(&[slope]);
            let challenge = prover.challenge();
            claim += (challenge - point[bound]) * slope;
            bind(&mut message, challenge);
            bound += 1;
        }
        committed.push((tree, codeword));
    }
    if let Lie::LastMessage = lie {
        let weights = eq_table(&point[bound..]);
        let missing = claim - sum(&weights, &message);
        message[0] += missing * weights[0].inverse();
    }
    prover.send_extension(&message);
    do_work(prover, WORK, "positions", lie);
    let length = parameters.variables() as u32 + RATE.bits();
    for position in prover.positions(QUERIES, length) {
        for (tree, segment) in worlds.trees.iter().zip(of(Lie::Rows)) {
            tree.open(prover, segment.row(position), position);
        }
        let mut leaf = position;
        for (tree, codeword) in &committed {
            let count = codeword.len() / SIBLINGS;
            leaf %= count;
            let siblings: [Extension; SIBLINGS] =
                core::array::from_fn(|sibling| codeword[leaf + sibling * count]);
            tree.open(prover, Extension::coefficients(&siblings), leaf);
        }
    }
}

/// Does a proof of work, or says anything where the lie is that it was done.
pub fn do_work(prover: &mut Prover, bits: u32, what: &'static str, lie: Lie) {
    if lie != Lie::Idle(what) {
        return work::do_work(prover, bits);
    }
    prover.send(&[Goldilocks::ZERO]);
    // Whether the work was done is drawn like a challenge.
    prover.challenge();
}

fn sum(weights: &[Extension], values: &[Extension]) -> Extension {
    let terms = weights.iter().zip(values);
    terms.map(|(&weight, &value)| weight * value).sum()
}

/// The codeword: the polynomial with these coefficients at all powers of a root of unity.
fn encode(coefficients: &[Extension]) -> Vec<Extension> {
    let mut padded = coefficients.to_vec();
    padded.resize(coefficients.len() << RATE.bits(), Extension::ZERO);
    let root = Goldilocks::root_of_unity(padded.len().ilog2());
    at_powers(&padded, root)
}

fn at_powers(coefficients: &[Extension], root: Goldilocks) -> Vec<Extension> {
    if let [constant] = coefficients {
        return vec![*constant];
    }
    let half = |first: usize| -> Vec<Extension> {
        let own: Vec<_> = coefficients
            .iter()
            .copied()
            .skip(first)
            .step_by(2)
            .collect();
        at_powers(&own, root * root)
    };
    let (even, odd) = (half(0), half(1));
    let mut power = Goldilocks::ONE;
    let (mut low, mut high) = (vec![], vec![]);
    for (&even, &odd) in even.iter().zip(&odd) {
        let odd = odd.scale(power);
        low.push(even + odd);
        high.push(even - odd);
        power *= root;
    }
    low.extend(high);
    low
}
