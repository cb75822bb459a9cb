//! Sums of fractions.

use zk0_argument::field::{Extension, Goldilocks};
use zk0_argument::form::Equations;
use zk0_argument::fractions::{prove, verify, LeafClaim};
use zk0_argument::hash::SpongeDigest;
use zk0_argument::multilinear::eq_table;
use zk0_argument::transcript::{Pads, Prover, Refused, Verifier};

const STATEMENT: SpongeDigest = SpongeDigest([9, 8, 7, 6]);

/// Fractions whose sum is zero: the last one makes it so.
fn fractions(count: usize) -> (Vec<Extension>, Vec<Extension>) {
    let element = |seed: u64| {
        Extension([
            Goldilocks::from_i64((seed * 977 + 5) as i64),
            Goldilocks::from_i64(-(seed as i64)),
        ])
    };
    let mut numerators: Vec<_> = (0..count as u64).map(element).collect();
    let denominators: Vec<_> = (0..count as u64).map(|seed| element(seed + 1000)).collect();
    let terms = numerators.iter().zip(&denominators).take(count - 1);
    let sum: Extension = terms.map(|(&p, &q)| p * q.inverse()).sum();
    numerators[count - 1] = -sum * denominators[count - 1];
    (numerators, denominators)
}

fn evaluate(values: &[Extension], point: &[Extension]) -> Extension {
    eq_table(point)
        .iter()
        .zip(values)
        .map(|(&weight, &value)| weight * value)
        .sum()
}

/// An argument and its secret values, and the claim that it leaves.
fn proof(
    numerators: &[Extension],
    denominators: &[Extension],
) -> (Vec<u64>, Vec<Extension>, LeafClaim) {
    let pads = Pads::new(fractions(1 << 9).0);
    let mut prover = Prover::new(&STATEMENT, pads);
    let claim = prove::sum(&mut prover, numerators.to_vec(), denominators.to_vec());
    let secrets = prover.secrets().to_vec();
    (prover.finish().unwrap(), secrets, claim)
}

/// The claim that is left, for secret values that are known, where all equations hold.
fn check(variables: usize, proof: &[u64], secrets: &[Extension]) -> Result<LeafClaim, Refused> {
    let mut verifier = Verifier::new(&STATEMENT, proof);
    let mut equations = Equations::default();
    let claim = verify(&mut verifier, variables, &mut equations)?;
    verifier.finish()?;
    match equations.unmet(secrets) {
        Some(unmet) => Err(Refused::Equation(unmet)),
        None => Ok(LeafClaim {
            point: claim.point,
            numerator: claim.numerator.value(secrets, &[]),
            denominator: claim.denominator.value(secrets, &[]),
        }),
    }
}

#[test]
fn a_sum_that_is_zero_becomes_a_claim_about_the_fractions() {
    for variables in 1..=11 {
        let (numerators, denominators) = fractions(1 << variables);
        let (proof, secrets, claim) = proof(&numerators, &denominators);
        assert_eq!(check(variables, &proof, &secrets).as_ref(), Ok(&claim));
        assert_eq!(claim.numerator, evaluate(&numerators, &claim.point));
        assert_eq!(claim.denominator, evaluate(&denominators, &claim.point));
    }
}

#[test]
fn a_sum_that_is_not_zero_is_refused() {
    let (mut numerators, denominators) = fractions(64);
    numerators[17] += Extension::ONE;
    let (proof, secrets, _) = proof(&numerators, &denominators);
    assert_eq!(
        check(6, &proof, &secrets),
        Err(Refused::Equation("a sum of look-ups"))
    );
}

#[test]
fn a_denominator_that_is_zero_is_refused() {
    let (mut numerators, mut denominators) = fractions(8);
    denominators[3] = Extension::ZERO;
    numerators[3] = Extension::ZERO;
    let (proof, secrets, _) = proof(&numerators, &denominators);
    assert_eq!(
        check(3, &proof, &secrets),
        Err(Refused::Equation("the inverse of a denominator"))
    );
}

#[test]
fn every_word_of_a_proof_matters() {
    let (numerators, denominators) = fractions(32);
    let (proof, secrets, claim) = proof(&numerators, &denominators);
    for place in 0..proof.len() {
        let mut changed = proof.clone();
        changed[place] ^= 1;
        // The last words are the claim about the leaves, which something else has to check.
        assert_ne!(
            check(5, &changed, &secrets),
            Ok(claim.clone()),
            "word {place} of {}",
            proof.len()
        );
    }
}
