//! A commitment to one multilinear polynomial of 2^(height + columns) field elements, opened at many points at once.
//!
//! Commitment: the values are cut into 2^columns columns of 2^height; each is Reed–Solomon encoded, and row i of all
//! codewords is leaf i of a Merkle tree.
//!
//! Opening, in four steps:
//! 1. *Batching.* Claims f(z_i) = v_i become one, f(r) = v, by a sumcheck of Σ_x f(x) · Σ_i α^i·eq(z_i, x).
//! 2. *Columns.* The prover says the columns' values at the lower part of r; eq of the upper part must make v of them.
//!    A random combination of the columns is opened in their place.
//! 3. *BaseFold* (Zeilberger, Chen, Fisch 2023): its codeword is folded with the challenges of a sumcheck, as in FRI;
//!    every [`ARITY`]-th one is committed; the last polynomial is said in full.
//! 4. *Queries* at random positions, after a proof of work: each folding step, and the first codeword against the
//!    committed rows.

use crate::{
    field::{E, F},
    matmul::Claim,
    merkle::{self, Tree},
    multilinear::{bind, eq, eq_bits, eq_table, evaluate},
    poseidon2::Digest,
    sumcheck,
    transcript::{Challenges, Prover, Refused, Verifier},
};

/// Variables bound between two committed codewords: leaves hold 2^ARITY values.
const ARITY: usize = 3;
const SIBLINGS: usize = 1 << ARITY;

/// Dimensions and strength; the first three are binary logarithms.
#[derive(Clone, Copy, Debug)]
pub struct Parameters {
    /// Rows of the committed matrix.
    pub height: usize,
    /// Its columns.
    pub columns: usize,
    /// Length of a codeword over that of its message.
    pub blowup: usize,
    /// Positions queried.
    pub queries: usize,
    /// Bits of the proof of work.
    pub grinding: usize,
}

impl Parameters {
    /// For 2^`variables` values: 102 bits by the queries in the unique decoding regime, of which 16 by work, so that
    /// with the other terms in the README 100 are left.
    pub fn new(variables: usize, columns: usize, blowup: usize) -> Self {
        let agreement = 0.5 + 0.5 / (1u64 << blowup) as f64;
        let grinding = 16;
        let queries = ((102 - grinding) as f64 / -agreement.log2()).ceil() as usize;
        Self { height: variables - columns, columns, blowup, queries, grinding }
    }

    /// Number of variables of the committed polynomial.
    pub fn variables(&self) -> usize {
        self.height + self.columns
    }

    /// Committed folding steps; what is left then is said: 2^3 to 2^5 values.
    fn steps(&self) -> usize {
        (self.height - 3) / ARITY
    }

    fn codeword(&self) -> usize {
        self.height + self.blowup
    }

    fn check(&self) -> Result<(), Refused> {
        let fits = (6..=24).contains(&self.height) && self.codeword() <= 24 && self.columns <= 10;
        match fits && self.grinding < 31 {
            true => Ok(()),
            false => Err(Refused::Parameters),
        }
    }
}

/// Claims at one point on parts of the committed list: aligned blocks as long as the point has it, and their values.
#[derive(Clone, Debug)]
pub struct Opening {
    /// A point in a block.
    pub point: Vec<E>,
    /// Number of the block, and the value there.
    pub blocks: Vec<(usize, E)>,
}

/// The prover's side of a commitment.
pub struct Committed {
    parameters: Parameters,
    values: Vec<F>,
    tree: Tree,
}

/// Commits to `values` (as many as the parameters say) and says the root.
pub fn commit(prover: &mut Prover, parameters: Parameters, values: Vec<F>) -> Committed {
    let (columns, length) = (1 << parameters.columns, 1 << parameters.codeword());
    let roots = roots(parameters.codeword());
    let mut rows = vec![F::ZERO; length * columns];
    for (column, message) in values.chunks_exact(1 << parameters.height).enumerate() {
        let mut codeword = message.to_vec();
        codeword.resize(length, F::ZERO);
        ntt(&mut codeword, &roots);
        for (row, value) in rows.chunks_exact_mut(columns).zip(codeword) {
            row[column] = value;
        }
    }
    let tree = Tree::new(rows, columns);
    prover.send(&tree.root());
    Committed { parameters, values, tree }
}

impl Committed {
    /// Opens all claims.
    pub fn open(&self, prover: &mut Prover, openings: &[Opening]) {
        let parameters = &self.parameters;
        // 1. Batching.
        let alpha = prover.challenge();
        let mut weights = vec![E::ZERO; self.values.len()];
        let mut power = E::ONE;
        for opening in openings {
            let table = eq_table(&opening.point);
            for &(block, _) in &opening.blocks {
                for (weight, &value) in weights[block << opening.point.len()..].iter_mut().zip(&table) {
                    *weight += power * value;
                }
                power = power * alpha;
            }
        }
        let values = self.values.iter().map(|&value| value.into()).collect();
        let (point, [value, _]) = sumcheck::prove(prover, values, weights);
        prover.send_extension(&[value]);

        // 2. Columns.
        let lower = &point[..parameters.height];
        let columns = || self.values.chunks_exact(1 << parameters.height);
        let column_values: Vec<E> = columns().map(|column| evaluate(column, lower)).collect();
        prover.send_extension(&column_values);
        let weights = eq_table(&prover.challenges(parameters.columns));
        let mut message = vec![E::ZERO; 1 << parameters.height];
        for (column, &weight) in columns().zip(&weights) {
            for (sum, &value) in message.iter_mut().zip(column) {
                *sum += weight.scale(value);
            }
        }

        // 3. BaseFold.
        let mut codeword = encode(&message, parameters.blowup);
        let mut trees = Vec::new();
        let mut bound = 0;
        for _ in 0..parameters.steps() {
            let tree = commit_codeword(&codeword);
            prover.send(&tree.root());
            trees.push(tree);
            for _ in 0..ARITY {
                // g(1) − g(0) of the linear g with (1 − z)·g(0) + z·g(1) = claim; eq is left out as in `fractions`.
                let weights = eq_table(&lower[bound + 1..]);
                let slope = message.chunks_exact(2).zip(&weights);
                let slope = slope.fold(E::ZERO, |sum, (pair, &weight)| sum + weight * (pair[1] - pair[0]));
                prover.send_extension(&[slope]);
                let challenge = prover.challenge();
                bind(&mut message, challenge);
                codeword = fold(&codeword, challenge);
                bound += 1;
            }
        }
        prover.send_extension(&message);

        // 4. Queries.
        prover.grind(parameters.grinding);
        for mut index in positions(prover, parameters) {
            prover.hint(&self.tree.open(index));
            for (step, tree) in trees.iter().enumerate() {
                index &= (1 << (parameters.codeword() - ARITY * (step + 1))) - 1;
                prover.hint(&tree.open(index));
            }
        }
    }
}

/// Reads a commitment.
pub fn receive<'a>(verifier: &mut Verifier<'a>) -> Result<&'a Digest, Refused> {
    verifier.receive(8)?.try_into().map_err(|_| Refused::Length)
}

/// Checks that all claims hold for the polynomial committed to by `root`.
pub fn verify(
    verifier: &mut Verifier,
    parameters: &Parameters,
    root: &Digest,
    openings: &[Opening],
) -> Result<(), Refused> {
    parameters.check()?;
    // 1. Batching.
    let alpha = verifier.challenge();
    let (mut claim, mut power) = (E::ZERO, E::ONE);
    for &(_, value) in openings.iter().flat_map(|opening| &opening.blocks) {
        claim += power * value;
        power = power * alpha;
    }
    let (point, last) = sumcheck::verify(verifier, parameters.variables(), claim)?;
    let [value] = *verifier.receive_extension(1)? else { return Err(Refused::Length) };
    let (mut weight, mut power) = (E::ZERO, E::ONE);
    for opening in openings {
        let (inside, above) = point.split_at(opening.point.len());
        let mut sum = E::ZERO;
        for &(block, _) in &opening.blocks {
            sum += power * eq_bits(block, above);
            power = power * alpha;
        }
        weight += sum * eq(&opening.point, inside);
    }
    if value * weight != last {
        return Err(Refused::Sumcheck("batch of openings"));
    }

    // 2. Columns.
    let (lower, upper) = point.split_at(parameters.height);
    let column_values = verifier.receive_extension(1 << parameters.columns)?;
    let dot = |weights: &[E]| weights.iter().zip(column_values).fold(E::ZERO, |sum, (&w, &v)| sum + w * v);
    if dot(&eq_table(upper)) != value {
        return Err(Refused::Columns);
    }
    let weights = eq_table(&verifier.challenges(parameters.columns));
    let mut claim = dot(&weights);

    // 3. BaseFold.
    let mut steps: Vec<(&Digest, [E; ARITY])> = Vec::with_capacity(parameters.steps());
    let mut coordinates = lower.iter();
    for _ in 0..parameters.steps() {
        let root = receive(verifier)?;
        let mut challenges = [E::ZERO; ARITY];
        for (challenge, &coordinate) in challenges.iter_mut().zip(&mut coordinates) {
            let [slope] = *verifier.receive_extension(1)? else { return Err(Refused::Length) };
            *challenge = verifier.challenge();
            claim = claim + (*challenge - coordinate) * slope;
        }
        steps.push((root, challenges));
    }
    let message = verifier.receive_extension(1 << coordinates.len())?;
    let expected = eq_table(coordinates.as_slice());
    if expected.iter().zip(message).fold(E::ZERO, |sum, (&weight, &value)| sum + weight * value) != claim {
        return Err(Refused::FinalPolynomial);
    }

    // 4. Queries.
    verifier.check_grinding(parameters.grinding)?;
    let roots = Roots::new(parameters);
    for index in positions(verifier, parameters) {
        let row = merkle::open(verifier, root, parameters.codeword(), index, 1 << parameters.columns)?;
        check_query(verifier, &roots, &steps, message, index, E::dot_base(&weights, row))?;
    }
    Ok(())
}

/// Follows one position through the folding steps to the final polynomial.
#[inline(always)]
fn check_query(
    verifier: &mut Verifier,
    roots: &Roots,
    steps: &[(&Digest, [E; ARITY])],
    message: &[E],
    mut index: usize,
    mut value: E,
) -> Result<(), Refused> {
    let mut length = roots.length;
    // generator^index and its inverse, at the length of the current codeword.
    let mut inverse = roots.inverse_power(index);
    for (root, challenges) in steps {
        length -= ARITY;
        let sibling = index >> length;
        index &= (1 << length) - 1;
        let siblings = E::from_slice(merkle::open(verifier, *root, length, index, 4 * SIBLINGS)?);
        if siblings[sibling] != value {
            return Err(Refused::Fold);
        }
        // The inverse of generator^index for the index without its top bits.
        inverse = inverse * roots.siblings[sibling];
        value = fold_siblings(roots, siblings, challenges, inverse);
        for _ in 0..ARITY {
            inverse = inverse * inverse;
        }
    }
    // The final message's codeword at this position, by Horner's rule.
    let x = roots.power(index << (roots.length - length));
    let expected = message.iter().rev().fold(E::ZERO, |sum, &coefficient| sum.scale(x) + coefficient);
    match expected == value {
        true => Ok(()),
        false => Err(Refused::Fold),
    }
}

/// Folds 2^ARITY values, [`ARITY`] times. Each fold is `((1 − r)(u + v) + r·(u − v)/x) / 2`.
#[inline(always)]
fn fold_siblings(roots: &Roots, siblings: &[E], challenges: &[E; ARITY], mut inverse: F) -> E {
    let mut values: [E; SIBLINGS] = core::array::from_fn(|i| siblings[i]);
    let mut half = SIBLINGS / 2;
    let mut stride = 1;
    for &challenge in challenges {
        for i in 0..half {
            // The point of value i is that of value 0 times a root of unity of order 2·half.
            let inverse = if i == 0 { inverse } else { inverse * roots.inverse_siblings[i * stride] };
            let (u, v) = (values[i], values[i + half]);
            let sum = u + v;
            values[i] = sum + challenge * ((u - v).scale(inverse) - sum);
        }
        inverse = inverse * inverse;
        half /= 2;
        stride *= 2;
    }
    // The halves that were left out.
    values[0].scale(roots.eighth)
}

/// Powers of roots of unity that the queries need.
struct Roots {
    /// Binary logarithm of the first codeword's length.
    length: usize,
    /// generator^(2^i).
    squares: Vec<F>,
    inverse_squares: Vec<F>,
    /// Powers of a root of unity of order 2^ARITY, and their inverses.
    siblings: [F; SIBLINGS],
    inverse_siblings: [F; SIBLINGS],
    eighth: F,
}

impl Roots {
    fn new(parameters: &Parameters) -> Self {
        let length = parameters.codeword();
        let generator = F::root_of_unity(length);
        let squares = |first: F| core::iter::successors(Some(first), |&x| Some(x * x)).take(length).collect();
        let order_eight = F::root_of_unity(ARITY);
        Self {
            length,
            squares: squares(generator),
            inverse_squares: squares(generator.inverse()),
            siblings: core::array::from_fn(|i| order_eight.pow(i as u64)),
            inverse_siblings: core::array::from_fn(|i| order_eight.pow((SIBLINGS - i) as u64)),
            eighth: F(SIBLINGS as u32).inverse(),
        }
    }

    fn power(&self, exponent: usize) -> F {
        product_of_squares(&self.squares, exponent)
    }

    fn inverse_power(&self, exponent: usize) -> F {
        product_of_squares(&self.inverse_squares, exponent)
    }
}

fn product_of_squares(squares: &[F], exponent: usize) -> F {
    let chosen = squares.iter().enumerate().filter(|(bit, _)| exponent >> bit & 1 == 1);
    chosen.fold(F::ONE, |product, (_, &square)| product * square)
}

/// Positions to query. p − 1 is a multiple of 2^24: the low bits of a random element are as good as uniform.
fn positions(challenges: &mut impl Challenges, parameters: &Parameters) -> Vec<usize> {
    let mask = (1 << parameters.codeword()) - 1;
    let drawn = challenges.challenges(parameters.queries.div_ceil(4));
    let mut positions: Vec<usize> = drawn.iter().flat_map(|e| e.0).map(|value| value.0 as usize & mask).collect();
    positions.truncate(parameters.queries);
    positions
}

/// A leaf of a folded codeword: the values that fold into one, an eighth of the codeword apart.
fn commit_codeword(codeword: &[E]) -> Tree {
    let leaves = codeword.len() / SIBLINGS;
    let mut rows = Vec::with_capacity(4 * codeword.len());
    for leaf in 0..leaves {
        for sibling in 0..SIBLINGS {
            rows.extend(codeword[leaf + sibling * leaves].0);
        }
    }
    Tree::new(rows, 4 * SIBLINGS)
}

/// The codeword of the polynomial with one variable bound: half as long.
fn fold(codeword: &[E], challenge: E) -> Vec<E> {
    let half = codeword.len() / 2;
    let step = F::root_of_unity(codeword.len().trailing_zeros() as usize).inverse();
    let two = F(2).inverse();
    let (first, second) = codeword.split_at(half);
    let mut inverse = F::ONE;
    let pairs = first.iter().zip(second);
    let folded = pairs.map(|(&u, &v)| {
        let sum = u + v;
        let value = (sum + challenge * ((u - v).scale(inverse) - sum)).scale(two);
        inverse = inverse * step;
        value
    });
    folded.collect()
}

/// The codeword of a message over the extension: its four coordinates one by one.
fn encode(message: &[E], blowup: usize) -> Vec<E> {
    let length = message.len() << blowup;
    let roots = roots(length.trailing_zeros() as usize);
    let mut codeword = vec![E::ZERO; length];
    for coordinate in 0..4 {
        let mut values: Vec<F> = message.iter().map(|value| value.0[coordinate]).collect();
        values.resize(length, F::ZERO);
        ntt(&mut values, &roots);
        for (target, value) in codeword.iter_mut().zip(values) {
            target.0[coordinate] = value;
        }
    }
    codeword
}

/// The first half of the powers of a root of unity of order 2^`bits`.
fn roots(bits: usize) -> Vec<F> {
    let generator = F::root_of_unity(bits);
    core::iter::successors(Some(F::ONE), |&x| Some(x * generator)).take(1 << bits >> 1).collect()
}

/// Values of the polynomial with these coefficients at all powers of the root of unity, in their order.
fn ntt(values: &mut [F], roots: &[F]) {
    let bits = values.len().trailing_zeros();
    for index in 0..values.len() {
        let reversed = index.reverse_bits() >> (usize::BITS - bits);
        if index < reversed {
            values.swap(index, reversed);
        }
    }
    let mut half = 1;
    while half < values.len() {
        let stride = values.len() / (2 * half);
        for block in values.chunks_exact_mut(2 * half) {
            let (low, high) = block.split_at_mut(half);
            for ((low, high), root) in low.iter_mut().zip(high).zip(roots.iter().step_by(stride)) {
                let product = *high * *root;
                (*low, *high) = (*low + product, *low - product);
            }
        }
        half *= 2;
    }
}

impl From<Claim> for Opening {
    fn from(claim: Claim) -> Self {
        Self { point: claim.point, blocks: vec![(0, claim.value)] }
    }
}
