//! Look-ups in tables by LogUp (Haböck 2022): every pair looked up is a row of its table if and only if
//! `Σ 1/(γ − f(look-up)) = Σ multiplicity/(γ − f(row))`, with f = tag + β·input + β²·output for random β and γ.
//!
//! One sum has both kinds of look-ups that a layer needs: pairs of the activation's table (2^16 rows: int16 input, as
//! its offset from −2^15, and output), which also show that the input is an int16; and remainders in 0..2^shift.

use crate::{
    field::{E, F},
    fractions,
    matmul::Claim,
    multilinear::{eq_bits, evaluate},
    transcript::{Challenges, Prover, Refused, Verifier},
};

/// Bits of work before β and γ are drawn. Two times the number of fractions, over the size of the field, is what a cheat
/// may hope for: 2^-96 with 2^27 of them.
const GRINDING: usize = 12;
/// Rows of the activation's table, as a power of two.
pub const TABLE_BITS: usize = 16;
const OFFSET: u32 = 1 << (TABLE_BITS - 1);

/// How many look-ups: binary logarithms.
#[derive(Clone, Copy, Debug)]
pub struct Shape {
    /// Of pairs, and of remainders.
    pub lookups: usize,
    /// Rows of the remainders' table.
    pub shift: usize,
}

/// The committed values that a look-up argument speaks of.
#[derive(Clone, Debug)]
pub struct Columns<T> {
    /// Inputs of the activation, signed.
    pub inputs: T,
    /// Its outputs.
    pub outputs: T,
    /// Remainders.
    pub remainders: T,
    /// How often each row of the activation's table is looked up.
    pub table_counts: T,
    /// How often each remainder occurs.
    pub remainder_counts: T,
}

/// What is left to show.
#[derive(Clone, Debug)]
pub struct Claims {
    /// Where inputs, outputs and remainders are claimed.
    pub lookup_point: Vec<E>,
    /// Where the activation's table and its counts are claimed.
    pub table_point: Vec<E>,
    /// Where the remainders' counts are claimed.
    pub remainder_point: Vec<E>,
    /// The claimed values, opened by the commitment.
    pub values: Columns<E>,
    /// Of the table: public, whoever holds it evaluates it.
    pub table: Claim,
}

impl Shape {
    /// Blocks of leaves in their order: number of variables of each. Aligned, as the greater come first.
    fn blocks(&self) -> [usize; 4] {
        [self.lookups, self.lookups, TABLE_BITS, self.shift]
    }

    fn leaf_variables(&self) -> usize {
        self.blocks().iter().map(|bits| 1usize << bits).sum::<usize>().next_power_of_two().trailing_zeros() as usize
    }

    fn check(&self) -> Result<(), Refused> {
        match self.lookups >= TABLE_BITS && self.lookups <= 28 && (1..=TABLE_BITS).contains(&self.shift) {
            true => Ok(()),
            false => Err(Refused::Parameters),
        }
    }
}

/// Counts of the rows looked up.
pub fn counts(inputs: &[F], remainders: &[F], shape: &Shape) -> (Vec<F>, Vec<F>) {
    let mut table_counts = vec![F::ZERO; 1 << TABLE_BITS];
    let mut remainder_counts = vec![F::ZERO; 1 << shape.shift];
    for (&input, remainder) in inputs.iter().zip(remainders) {
        // A cheat's value without a row is counted nowhere.
        if let Some(count) = table_counts.get_mut((input + F(OFFSET)).0 as usize) {
            *count = *count + F::ONE;
        }
        if let Some(count) = remainder_counts.get_mut(remainder.0 as usize) {
            *count = *count + F::ONE;
        }
    }
    (table_counts, remainder_counts)
}

/// Proves the look-ups. `table` holds the outputs for all inputs, from −2^15 on.
pub fn prove(prover: &mut Prover, shape: &Shape, columns: &Columns<&[F]>, table: &[F]) -> Claims {
    prover.grind(GRINDING);
    let [beta, gamma] = [prover.challenge(), prover.challenge()];
    let beta_squared = beta * beta;
    let pair = |offset: F, output: F| gamma - beta.scale(offset) - beta_squared.scale(output);
    let remainder = |value: F| gamma - E::ONE - beta.scale(value);
    let variables = shape.leaf_variables();
    let (mut numerators, mut denominators) = (Vec::with_capacity(1 << variables), Vec::with_capacity(1 << variables));
    for (&input, &output) in columns.inputs.iter().zip(columns.outputs) {
        denominators.push(pair(input + F(OFFSET), output));
    }
    denominators.extend(columns.remainders.iter().map(|&value| remainder(value)));
    numerators.resize(denominators.len(), E::ONE);
    denominators.extend(table.iter().zip(0..).map(|(&output, row)| pair(F(row), output)));
    denominators.extend((0..1 << shape.shift).map(|row| remainder(F(row))));
    numerators.extend(columns.table_counts.iter().chain(columns.remainder_counts).map(|&count| E::from(-count)));
    numerators.resize(1 << variables, E::ZERO);
    denominators.resize(1 << variables, E::ONE);

    let (point, _, _) = fractions::prove(prover, numerators, denominators);
    let [lookup_point, table_point, remainder_point] = points(shape, &point);
    let values = Columns {
        inputs: evaluate(columns.inputs, lookup_point),
        outputs: evaluate(columns.outputs, lookup_point),
        remainders: evaluate(columns.remainders, lookup_point),
        table_counts: evaluate(columns.table_counts, table_point),
        remainder_counts: evaluate(columns.remainder_counts, remainder_point),
    };
    let table = evaluate(table, table_point);
    prover.send_extension(&[
        values.inputs,
        values.outputs,
        values.remainders,
        values.table_counts,
        values.remainder_counts,
        table,
    ]);
    claims([lookup_point, table_point, remainder_point], values, table)
}

/// Checks the look-ups; gives the claims that are left.
pub fn verify(verifier: &mut Verifier, shape: &Shape) -> Result<Claims, Refused> {
    shape.check()?;
    verifier.check_grinding(GRINDING)?;
    let [beta, gamma] = [verifier.challenge(), verifier.challenge()];
    let (point, p, q) = fractions::verify(verifier, shape.leaf_variables())?;
    let [lookup_point, table_point, remainder_point] = points(shape, &point);
    let [inputs, outputs, remainders, table_counts, remainder_counts, table] = *verifier.receive_extension(6)? else {
        return Err(Refused::Length);
    };
    // The row number of either table is the multilinear Σ 2^i·x_i.
    let row = |point: &[E]| point.iter().rev().fold(E::ZERO, |sum, &coordinate| sum + sum + coordinate);
    let pair = |offset: E, output: E| gamma - beta * (offset + beta * output);
    let remainder = |value: E| gamma - E::ONE - beta * value;
    let leaves = [
        (E::ONE, pair(inputs + F(OFFSET).into(), outputs)),
        (E::ONE, remainder(remainders)),
        (E::ZERO - table_counts, pair(row(table_point), table)),
        (E::ZERO - remainder_counts, remainder(row(remainder_point))),
    ];
    // Numerators and denominators at the point; the padding has 0/1.
    let (mut numerator, mut denominator) = (E::ZERO, E::ONE);
    let mut start = 0;
    for (variables, (p, q)) in shape.blocks().into_iter().zip(leaves) {
        let weight = eq_bits(start >> variables, &point[variables..]);
        numerator += weight * p;
        denominator += weight * (q - E::ONE);
        start += 1 << variables;
    }
    if numerator != p || denominator != q {
        return Err(Refused::Lookup);
    }
    let values = Columns { inputs, outputs, remainders, table_counts, remainder_counts };
    Ok(claims([lookup_point, table_point, remainder_point], values, table))
}

/// The parts of the leaves' point that the columns are claimed at.
fn points<'a>(shape: &Shape, point: &'a [E]) -> [&'a [E]; 3] {
    [&point[..shape.lookups], &point[..TABLE_BITS], &point[..shape.shift]]
}

fn claims([lookup, table, remainder]: [&[E]; 3], values: Columns<E>, table_value: E) -> Claims {
    Claims {
        lookup_point: lookup.to_vec(),
        table_point: table.to_vec(),
        remainder_point: remainder.to_vec(),
        values,
        table: Claim { point: table.to_vec(), value: table_value },
    }
}
