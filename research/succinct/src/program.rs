//! What the guest program runs: the verifier of one part, or of a whole layer. The parts by themselves are there to be
//! measured; each leaves claims, whose digest is the public result.

use crate::{
    commitment::{self, Opening, Parameters},
    field::{E, F},
    layer, lookup, matmul,
    multilinear::evaluate,
    poseidon2::{Digest, State},
    transcript::{Challenges, Refused, Verifier},
};

/// Domain of the digest of claims.
const CLAIMS: u32 = 4;

/// A statement: which verifier, and its dimensions.
#[derive(Clone, Copy, Debug)]
pub enum Statement {
    /// Nothing: what starting a program and reading its input costs.
    Nothing,
    /// A matrix product, whose claims are left.
    Product(matmul::Shape),
    /// Look-ups, whose claims are left.
    Lookups(lookup::Shape),
    /// The opening of a commitment.
    Opening(OpeningShape),
    /// A layer.
    Layer(layer::Shape),
    /// The evaluation of a public table of 2^16 entries, were it done in the guest.
    Table,
}

/// An opening by itself: `points` points, at each of which `blocks` blocks of 2^`local` values are claimed.
#[derive(Clone, Copy, Debug)]
pub struct OpeningShape {
    /// Binary logarithms: committed values, columns, blow-up.
    pub size: [usize; 3],
    /// Number of points.
    pub points: usize,
    /// Claims at each point.
    pub blocks: usize,
    /// Variables of a block.
    pub local: usize,
}

impl OpeningShape {
    /// Parameters of the commitment.
    pub fn parameters(&self) -> Parameters {
        let [variables, columns, blowup] = self.size;
        Parameters::new(variables, columns, blowup)
    }

    /// Which block a claim is about.
    pub fn block(&self, point: usize, block: usize) -> usize {
        (point * self.blocks + block) & ((1 << (self.size[0] - self.local)) - 1)
    }
}

impl Statement {
    /// The statement in numbers.
    pub fn to_words(self) -> Vec<u32> {
        let words = match self {
            Self::Nothing => vec![0],
            Self::Product(s) => vec![1, s.rows, s.inner, s.columns, s.shift],
            Self::Lookups(s) => vec![2, s.lookups, s.shift],
            Self::Opening(s) => vec![3, s.size[0], s.size[1], s.size[2], s.points, s.blocks, s.local],
            Self::Layer(s) => {
                let p = s.product;
                vec![4, p.rows, p.inner, p.columns, p.shift, s.commitment.0, s.commitment.1]
            }
            Self::Table => vec![5],
        };
        words.into_iter().map(|word| word as u32).collect()
    }

    /// The statement that these numbers say.
    pub fn from_words(words: &[u32]) -> Result<Self, Refused> {
        let words: Vec<usize> = words.iter().map(|&word| word as usize).collect();
        if words.iter().skip(1).any(|&word| word > 4096) {
            return Err(Refused::Parameters);
        }
        let product = |w: &[usize]| matmul::Shape { rows: w[0], inner: w[1], columns: w[2], shift: w[3] };
        Ok(match words[..] {
            [0] => Self::Nothing,
            [1, ..] if words.len() == 5 && words[4] < 31 => Self::Product(product(&words[1..])),
            [2, lookups, shift] => Self::Lookups(lookup::Shape { lookups, shift }),
            [3, variables, columns, blowup, points, blocks, local]
                if columns <= variables && local <= variables && blowup < 8 =>
            {
                Self::Opening(OpeningShape { size: [variables, columns, blowup], points, blocks, local })
            }
            [4, _, _, _, _, columns, blowup] if words[1..5].iter().all(|&w| w < 24) && columns < 11 && blowup < 8 => {
                Self::Layer(layer::Shape { product: product(&words[1..5]), commitment: (columns, blowup) })
            }
            [5] => Self::Table,
            _ => return Err(Refused::Parameters),
        })
    }

    /// Verifies `proof`; gives the digest of what is left to show.
    pub fn verify(self, proof: &[F]) -> Result<Digest, Refused> {
        let mut verifier = Verifier::new(&self.to_words(), proof)?;
        let mut left = Vec::new();
        match self {
            Self::Nothing => return Ok([F::ZERO; 8]),
            Self::Product(shape) => {
                left.extend(commitment::receive(&mut verifier)?);
                let claims = matmul::verify(&mut verifier, &shape)?;
                for claim in [&claims.input, &claims.weights, &claims.narrowed] {
                    push_claim(&mut left, claim);
                }
                push(&mut left, &[claims.remainder]);
            }
            Self::Lookups(shape) => {
                left.extend(commitment::receive(&mut verifier)?);
                let claims = lookup::verify(&mut verifier, &shape)?;
                push(&mut left, &claims.lookup_point);
                push_claim(&mut left, &claims.table);
                let v = &claims.values;
                push(&mut left, &[v.inputs, v.outputs, v.remainders, v.table_counts, v.remainder_counts]);
            }
            Self::Opening(shape) => {
                let root = commitment::receive(&mut verifier)?;
                left.extend(root);
                let mut openings = Vec::with_capacity(shape.points);
                for point in 0..shape.points {
                    let at = verifier.challenges(shape.local);
                    let values = verifier.receive_extension(shape.blocks)?.iter().enumerate();
                    let blocks = values.map(|(block, &value)| (shape.block(point, block), value)).collect();
                    openings.push(Opening { point: at, blocks });
                }
                commitment::verify(&mut verifier, &shape.parameters(), root, &openings)?;
            }
            Self::Layer(shape) => {
                let (root, claims) = layer::verify(&mut verifier, &shape)?;
                left.extend(root);
                push_claim(&mut left, &claims.weights);
                push_claim(&mut left, &claims.table);
            }
            Self::Table => {
                let table = verifier.hint(1 << lookup::TABLE_BITS)?;
                let point = verifier.challenges(lookup::TABLE_BITS);
                push(&mut left, &[evaluate(table, &point)]);
            }
        }
        verifier.finish()?;
        let mut state = State::new(CLAIMS, left.len());
        state.absorb(&left);
        Ok(state.digest())
    }
}

fn push(left: &mut Vec<F>, values: &[E]) {
    left.extend_from_slice(E::as_coefficients(values));
}

fn push_claim(left: &mut Vec<F>, claim: &matmul::Claim) {
    push(left, &claim.point);
    push(left, &[claim.value]);
}
