//! What is measured: each part by itself at growing sizes, and a layer.

use crate::{
    clock::Clock,
    commitment::{self, Opening},
    field::F,
    layer, lookup, matmul,
    multilinear::evaluate,
    poseidon2::Digest,
    program::{OpeningShape, Statement},
    synthetic::{self, INPUT_BITS},
    transcript::{Challenges, Prover},
};

/// One statement with its proof, and what making it took.
pub struct Proven {
    /// What is proven.
    pub statement: Statement,
    /// The proof.
    pub proof: Vec<F>,
    /// Processor seconds of one thread, values and their synthesis not counted: commitment, and the rest.
    pub seconds: [f64; 2],
}

/// The layer of full size: 50 × 720 times 720 × 2048, padded; twelve bits narrowed away.
pub const PRODUCT: matmul::Shape = matmul::Shape { rows: 6, inner: 10, columns: 11, shift: 12 };
/// Its dimensions before padding.
pub const DIMENSIONS: [usize; 3] = [50, 720, 2048];

/// A root to absorb where the commitment itself is not part of what is measured.
const SOME_ROOT: Digest = [F::ONE; 8];

/// Names of all cases, and their statements.
pub fn all(largest: usize) -> Vec<(String, Statement)> {
    let mut cases = vec![
        ("nothing".to_string(), Statement::Nothing),
        ("matmul 50x720 · 720x2048".into(), Statement::Product(PRODUCT)),
        ("table of 2^16 in the guest".into(), Statement::Table),
        ("layer 50x720 · 720x2048, SiLU".into(), Statement::Layer(layer::Shape { product: PRODUCT, commitment: (4, 2) })),
    ];
    for lookups in (17..largest).step_by(3) {
        let shape = lookup::Shape { lookups, shift: PRODUCT.shift };
        cases.push((format!("look-ups 2·2^{lookups}"), Statement::Lookups(shape)));
    }
    let openings = [(20, 4, 2), (largest, 5, 2), (largest, 6, 2), (largest, 7, 2), (largest, 6, 1), (largest, 6, 3)];
    for (variables, columns, blowup) in openings {
        let size = [variables, columns, blowup];
        let shape = OpeningShape { size, points: 1, blocks: 1, local: variables };
        cases.push((format!("opening 2^{variables}, {} columns, rate 1/{}", 1 << columns, 1 << blowup), Statement::Opening(shape)));
    }
    for (points, blocks) in [(128, 1), (128, 4)] {
        let shape = OpeningShape { size: [largest, 6, 2], points, blocks, local: 17 };
        cases.push((format!("opening 2^{largest}, {points} points of {blocks} claims"), Statement::Opening(shape)));
    }
    cases
}

/// Makes the values and the proof.
pub fn prove(statement: Statement) -> Proven {
    let mut prover = Prover::new(&statement.to_words());
    let seconds = match statement {
        Statement::Nothing => [0.0; 2],
        Statement::Product(shape) => {
            let values = synthetic::layer(&shape, DIMENSIONS, 1);
            let start = Clock::start();
            prover.send(&SOME_ROOT);
            matmul::prove(&mut prover, &shape, &values.x, &values.w, &values.y, &values.remainder);
            [0.0, start.seconds()]
        }
        Statement::Lookups(shape) => {
            let table = synthetic::silu_table();
            let inputs = synthetic::values(1 << shape.lookups, 2);
            let outputs: Vec<F> = inputs.iter().map(|&x| table[(x + F(1 << 15)).0 as usize]).collect();
            let remainders = synthetic::remainders(1 << shape.lookups, shape.shift, 3);
            let start = Clock::start();
            let (table_counts, remainder_counts) = lookup::counts(&inputs, &remainders, &shape);
            let columns = lookup::Columns {
                inputs: &inputs[..],
                outputs: &outputs,
                remainders: &remainders,
                table_counts: &table_counts,
                remainder_counts: &remainder_counts,
            };
            prover.send(&SOME_ROOT);
            lookup::prove(&mut prover, &shape, &columns, &table);
            [0.0, start.seconds()]
        }
        Statement::Opening(shape) => {
            let values = synthetic::values(1 << shape.size[0], 4);
            let start = Clock::start();
            let committed = commitment::commit(&mut prover, shape.parameters(), values.clone());
            let commit = start.seconds();
            let mut openings = Vec::new();
            for point in 0..shape.points {
                let at = prover.challenges(shape.local);
                let places = (0..shape.blocks).map(|block| shape.block(point, block));
                let blocks: Vec<_> = places
                    .map(|place| (place, evaluate(&values[place << shape.local..][..1 << shape.local], &at)))
                    .collect();
                for values in blocks.chunks(shape.blocks) {
                    prover.send_extension(&values.iter().map(|&(_, value)| value).collect::<Vec<_>>());
                }
                openings.push(Opening { point: at, blocks });
            }
            let start = Clock::start();
            committed.open(&mut prover, &openings);
            [commit, start.seconds()]
        }
        Statement::Layer(shape) => {
            let values = synthetic::layer(&shape.product, DIMENSIONS, 1);
            let start = Clock::start();
            let claims = layer::prove(&mut prover, &shape, &values);
            let proving = start.seconds();
            assert!(claims.hold(&shape, &values.w, &values.table, INPUT_BITS), "public claims hold");
            [0.0, proving]
        }
        Statement::Table => {
            prover.hint(&synthetic::silu_table());
            [0.0; 2]
        }
    };
    Proven { statement, proof: prover.proof, seconds }
}
