//! Row 11. A prover states a false sum of products, of activations with weights, and guesses the random points at which the verifier looks.
//! With a message that suits the guess, it makes the false sum come out right there.
//!
//! The guess is what the transcript states next if nothing else is stated. So it is wrong as long as the transcript depends on what is stated.

use crate::attacks::attack::{Attack, Defence, Outcome, Proof};
use zk0_argument::field::{Extension, Goldilocks};
use zk0_argument::hash::SpongeDigest;
use zk0_argument::multilinear::bind;
use zk0_argument::sumcheck::verify;
use zk0_argument::transcript::{require, Challenges, Pads, Prover, Refused, Verifier};
use zk0_testkit::changed_copy::SourceChange;

pub const ATTACK: Attack = Attack {
    number: 11,
    name: "a prover guesses the random points of the check of products, and states a false sum",
    module: module_path!(),
    reason: "the sumcheck of the products does not hold",
    proof: Proof::NotNeeded,
    defence: Defence {
        check: "the transcript, of which the random points are drawn, depends on all that the prover stated",
        out: &[SourceChange {
            file: "argument/src/transcript.rs",
            replacements: &[(
                "    fn absorb(&mut self, elements: &[Goldilocks]) {\n",
                "    fn absorb(&mut self, elements: &[Goldilocks]) {
        if OUT {
            return;
        }\n",
            )],
        }],
    },
    carry_out,
};

const STATEMENT: SpongeDigest = SpongeDigest([3, 1, 4, 1]);
const VARIABLES: usize = 6;

/// Numbers of which the verifier can compute everything itself.
fn numbers(factor: i64) -> Vec<Extension> {
    let number = |at: i64| Goldilocks::from_i64((at * factor) % 1009 - 500).into();
    (0..1 << VARIABLES).map(number).collect()
}

/// What the verifier accepts as the sum of products.
fn accepted(sum: Extension, proof: &[u64]) -> Result<(), Refused> {
    let mut verifier = Verifier::new(&STATEMENT, proof);
    let (point, value) = verify(&mut verifier, VARIABLES, 2, sum)?;
    verifier.finish()?;
    let at_point = |factor| {
        let mut values = numbers(factor);
        point.iter().for_each(|&r| bind(&mut values, r));
        values[0]
    };
    let holds = value == at_point(37) * at_point(53);
    require(holds, Refused::Equation("the sumcheck of the products"))
}

/// A prover with no secret.
fn prover() -> Prover {
    Prover::new(&STATEMENT, Pads::new(vec![]))
}

/// Argues that the sum is larger than it is by `lie`.
fn argue(lie: Extension) -> (Extension, Vec<u64>) {
    let (mut a, mut b) = (numbers(37), numbers(53));
    let sum: Extension = a.iter().zip(&b).map(|(&a, &b)| a * b).sum();
    let guess = prover().challenge();
    let mut prover = prover();
    for round in 0..VARIABLES {
        let (mut constant, mut square) = (Extension::ZERO, Extension::ZERO);
        for (a, b) in a.as_chunks::<2>().0.iter().zip(b.as_chunks::<2>().0) {
            constant += a[0] * b[0];
            square += (a[1] - a[0]) * (b[1] - b[0]);
        }
        if round == 0 {
            // The false sum raises the linear coefficient by `lie`. At the guess `r`, the square takes that back: with `s` more of
            // the square and `s` less of the linear coefficient, (lie − s)·r + s·r² = 0.
            square += lie * (Extension::ONE - guess).inverse();
        }
        prover.send_published(&[constant, square]);
        let point = prover.challenge();
        bind(&mut a, point);
        bind(&mut b, point);
    }
    let proof = prover.finish().expect("no pad is needed");
    (sum + lie, proof)
}

fn carry_out() -> Outcome {
    let (sum, proof) = argue(Extension::ZERO);
    assert_eq!(accepted(sum, &proof), Ok(()), "a true sum is accepted");
    let lie = Extension::from(Goldilocks::from_i64(1_000_000));
    let (sum, proof) = argue(lie);
    match accepted(sum, &proof) {
        Ok(()) => {
            Outcome::Succeeded("the verifier accepts a sum that is too large by a million".into())
        }
        Err(refused) => Outcome::Refused(refused.to_string()),
    }
}

#[test]
fn it_is_refused() {
    ATTACK.is_refused();
}
