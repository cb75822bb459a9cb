//! A changed product, look-up value or opening is refused; an honest proof is not.

use std::sync::LazyLock;
use zk0_succinct::{
    cases::{prove, Proven},
    commitment,
    field::F,
    layer, lookup, matmul,
    program::{OpeningShape, Statement},
    synthetic::{self, INPUT_BITS},
    transcript::{Prover, Refused, Verifier},
};

const PRODUCT: matmul::Shape = matmul::Shape { rows: 4, inner: 6, columns: 12, shift: 12 };
const LAYER: layer::Shape = layer::Shape { product: PRODUCT, commitment: (3, 2) };
static VALUES: LazyLock<layer::Values> = LazyLock::new(|| synthetic::layer(&PRODUCT, [13, 50, 3000], 1));

/// Proves and verifies a layer with these values; also checks the claims that are left.
fn check(values: &layer::Values) -> Result<bool, Refused> {
    let words = Statement::Layer(LAYER).to_words();
    let mut prover = Prover::new(&words);
    layer::prove(&mut prover, &LAYER, values);
    let mut verifier = Verifier::new(&words, &prover.proof)?;
    let (_, claims) = layer::verify(&mut verifier, &LAYER)?;
    verifier.finish()?;
    Ok(claims.hold(&LAYER, &VALUES.w, &VALUES.table, INPUT_BITS))
}

#[test]
fn an_honest_layer_is_accepted() {
    assert_eq!(check(&VALUES), Ok(true));
}

#[test]
fn a_changed_product_is_refused() {
    let mut values = VALUES.clone();
    // The activation follows, so that only the product is wrong.
    values.y[5] = values.y[5] + F::ONE;
    values.z[5] = values.table[(values.y[5] + F(1 << 15)).0 as usize];
    assert_eq!(check(&values), Err(Refused::Sumcheck("matrix product")));
}

#[test]
fn a_product_off_by_what_a_remainder_may_hide_is_refused() {
    let mut values = VALUES.clone();
    // One less, made up for by a remainder that is too great: the product holds, the range does not.
    values.y[5] = values.y[5] - F::ONE;
    values.remainder[5] = values.remainder[5] + F(1 << PRODUCT.shift);
    values.z[5] = values.table[(values.y[5] + F(1 << 15)).0 as usize];
    assert_eq!(check(&values), Err(Refused::Lookup));
}

#[test]
fn a_changed_lookup_value_is_refused() {
    let mut values = VALUES.clone();
    values.z[77] = values.z[77] + F::ONE;
    assert_eq!(check(&values), Err(Refused::Lookup));
}

#[test]
fn other_weights_or_another_table_fail_the_claims_that_are_left() {
    let mut values = VALUES.clone();
    // An unused row of the padding would change nothing: take a used one.
    values.w[3] = values.w[3] + F::ONE;
    // With other weights the product no longer holds.
    assert_eq!(check(&values), Err(Refused::Sumcheck("matrix product")));
    let mut values = VALUES.clone();
    // A table with another output everywhere: the look-ups hold in it, but it is not the public one.
    for output in values.table.iter_mut().chain(&mut values.z) {
        *output = *output + F::ONE;
    }
    assert_eq!(check(&values), Ok(false));
}

#[test]
fn weights_that_could_leave_the_field_are_refused() {
    let words = Statement::Layer(LAYER).to_words();
    let mut prover = Prover::new(&words);
    let claims = layer::prove(&mut prover, &LAYER, &VALUES);
    assert!(claims.hold(&LAYER, &VALUES.w, &VALUES.table, INPUT_BITS));
    assert!(!claims.hold(&LAYER, &VALUES.w, &VALUES.table, 16));
}

#[test]
fn any_changed_word_of_a_proof_is_refused() {
    let Proven { statement, proof, .. } = prove(Statement::Opening(OpeningShape {
        size: [12, 3, 2],
        points: 3,
        blocks: 2,
        local: 9,
    }));
    assert!(statement.verify(&proof).is_ok());
    let step = proof.len() / 400;
    for at in (0..200).chain((200..proof.len()).step_by(step)) {
        let mut changed = proof.clone();
        changed[at] = changed[at] + F::ONE;
        assert!(statement.verify(&changed).is_err(), "word {at} of {}", proof.len());
    }
    assert_eq!(statement.verify(&proof[..proof.len() - 1]), Err(Refused::Length));
    let longer: Vec<F> = proof.iter().copied().chain([F::ZERO]).collect();
    assert_eq!(statement.verify(&longer), Err(Refused::Length));
    let mut large = proof;
    large[0] = F(u32::MAX);
    assert_eq!(statement.verify(&large), Err(Refused::NotCanonical));
}

#[test]
fn an_opening_of_another_value_is_refused() {
    let parameters = commitment::Parameters::new(12, 3, 2);
    let values = synthetic::values(1 << 12, 9);
    let claims = |value: F| {
        let zero = zk0_succinct::field::E::ZERO;
        vec![commitment::Opening { point: vec![zero; 12], blocks: vec![(0, value.into())] }]
    };
    let run = |value: F| {
        let mut prover = Prover::new(&[]);
        let committed = commitment::commit(&mut prover, parameters, values.clone());
        committed.open(&mut prover, &claims(value));
        let mut verifier = Verifier::new(&[], &prover.proof)?;
        let root = commitment::receive(&mut verifier)?;
        commitment::verify(&mut verifier, &parameters, root, &claims(value))
    };
    assert_eq!(run(values[0]), Ok(()));
    assert!(run(values[0] + F::ONE).is_err());
}

#[test]
fn lookups_beside_their_tables_are_refused() {
    let statement = Statement::Lookups(lookup::Shape { lookups: 16, shift: 12 });
    let Proven { proof, .. } = prove(statement);
    assert!(statement.verify(&proof).is_ok());
    for at in (0..proof.len()).step_by(7) {
        let mut changed = proof.clone();
        changed[at] = changed[at] + F::ONE;
        // What is only absorbed before the first challenge, or claimed at the end, changes the claims or is refused.
        let left = statement.verify(&changed);
        assert!(left.is_err() || left != statement.verify(&proof), "word {at}");
    }
}
