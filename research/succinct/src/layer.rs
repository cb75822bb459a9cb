//! One linear layer of full size with its activation, all parts together: Y = X·W, narrowed to int16, then through a
//! table of 2^16 entries. The prover commits to X, narrowed Y, remainders, activations and the tables' counts; the
//! matrix product, the look-ups and the opening follow in one transcript.

use crate::{
    commitment::{self, Opening, Parameters},
    field::{E, F, P},
    lookup,
    matmul::{self, Claim},
    multilinear::evaluate,
    poseidon2::Digest,
    transcript::{Prover, Refused, Verifier},
};

/// Dimensions of the layer.
#[derive(Clone, Copy, Debug)]
pub struct Shape {
    /// Of the matrix product.
    pub product: matmul::Shape,
    /// Columns and blow-up of the commitment, as powers of two.
    pub commitment: (usize, usize),
}

/// A layer's values as field elements, matrices padded to powers of two.
#[derive(Clone, Debug)]
pub struct Values {
    /// Input.
    pub x: Vec<F>,
    /// Weights: public.
    pub w: Vec<F>,
    /// Narrowed product.
    pub y: Vec<F>,
    /// What narrowing took away.
    pub remainder: Vec<F>,
    /// Activation.
    pub z: Vec<F>,
    /// The activation's table, from −2^15 on: public.
    pub table: Vec<F>,
}

/// What a verified layer leaves to whoever holds weights and tables, which are public.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PublicClaims {
    /// On W.
    pub weights: Claim,
    /// On the activation's table.
    pub table: Claim,
}

impl PublicClaims {
    /// The second half of the verification, outside the guest: the claims hold for these weights and this table, and no
    /// sum over inputs of magnitude below 2^`input_bits` can reach p/2, so that sums in the field are sums of integers.
    pub fn hold(&self, shape: &Shape, weights: &[F], table: &[F], input_bits: usize) -> bool {
        let columns = 1 << shape.product.columns;
        let mut magnitudes = vec![0u64; columns];
        for row in weights.chunks_exact(columns) {
            for (sum, value) in magnitudes.iter_mut().zip(row) {
                *sum += value.0.min(P - value.0) as u64;
            }
        }
        let greatest = magnitudes.into_iter().max().unwrap_or(0) << input_bits;
        evaluate(weights, &self.weights.point) == self.weights.value
            && evaluate(table, &self.table.point) == self.table.value
            && greatest + (1 << shape.product.shift) < P as u64 / 2
            && shape.product.shift + 16 < 31
    }
}

impl Shape {
    fn outputs(&self) -> usize {
        self.product.rows + self.product.columns
    }

    fn lookups(&self) -> lookup::Shape {
        lookup::Shape { lookups: self.outputs(), shift: self.product.shift }
    }

    /// Binary logarithms of the committed parts in their order: y, z, remainders, then x and the counts.
    fn parts(&self) -> [usize; 6] {
        let Shape { product, .. } = self;
        let outputs = self.outputs();
        [outputs, outputs, outputs, product.rows + product.inner, lookup::TABLE_BITS, product.shift]
    }

    /// Where each part starts, aligned to its length, and where the last ends.
    fn places(&self) -> ([usize; 6], usize) {
        let mut end = 0usize;
        let places = self.parts().map(|bits| {
            let start = end.next_multiple_of(1 << bits);
            end = start + (1 << bits);
            start
        });
        (places, end)
    }

    /// Parameters of the commitment.
    pub fn parameters(&self) -> Parameters {
        let variables = self.places().1.next_power_of_two().trailing_zeros() as usize;
        Parameters::new(variables, self.commitment.0, self.commitment.1)
    }

    fn openings(&self, product: &matmul::Claims, lookups: &lookup::Claims) -> Vec<Opening> {
        let (parts, (places, _)) = (self.parts(), self.places());
        let block = |part: usize| places[part] >> parts[part];
        let open = |point: &[E], blocks: &[(usize, E)]| Opening {
            point: point.to_vec(),
            blocks: blocks.iter().map(|&(part, value)| (block(part), value)).collect(),
        };
        let values = &lookups.values;
        vec![
            open(&product.narrowed.point, &[(0, product.narrowed.value), (2, product.remainder)]),
            open(&lookups.lookup_point, &[(0, values.inputs), (1, values.outputs), (2, values.remainders)]),
            open(&product.input.point, &[(3, product.input.value)]),
            open(&lookups.table_point, &[(4, values.table_counts)]),
            open(&lookups.remainder_point, &[(5, values.remainder_counts)]),
        ]
    }
}

/// Proves the layer; gives the claims on public values.
pub fn prove(prover: &mut Prover, shape: &Shape, values: &Values) -> PublicClaims {
    let (table_counts, remainder_counts) = lookup::counts(&values.y, &values.remainder, &shape.lookups());
    let parts = [&values.y, &values.z, &values.remainder, &values.x, &table_counts, &remainder_counts];
    let parameters = shape.parameters();
    let mut stack = vec![F::ZERO; 1 << parameters.variables()];
    for (place, part) in shape.places().0.into_iter().zip(parts) {
        stack[place..][..part.len()].copy_from_slice(part);
    }
    let committed = commitment::commit(prover, parameters, stack);
    let product = matmul::prove(prover, &shape.product, &values.x, &values.w, &values.y, &values.remainder);
    let columns = lookup::Columns {
        inputs: &values.y[..],
        outputs: &values.z,
        remainders: &values.remainder,
        table_counts: &table_counts,
        remainder_counts: &remainder_counts,
    };
    let lookups = lookup::prove(prover, &shape.lookups(), &columns, &values.table);
    committed.open(prover, &shape.openings(&product, &lookups));
    PublicClaims { weights: product.weights, table: lookups.table }
}

/// Checks the layer's proof; gives the commitment and the claims on public values that are left.
pub fn verify(verifier: &mut Verifier, shape: &Shape) -> Result<(Digest, PublicClaims), Refused> {
    let root = commitment::receive(verifier)?;
    let product = matmul::verify(verifier, &shape.product)?;
    let lookups = lookup::verify(verifier, &shape.lookups())?;
    commitment::verify(verifier, &shape.parameters(), root, &shape.openings(&product, &lookups))?;
    Ok((*root, PublicClaims { weights: product.weights, table: lookups.table }))
}
