//! The verifier for a program's proofs. Each release of SP1 has its own, and cannot judge another release's proofs. A build
//! without the right one reports that it has not checked the proof.

use crate::proof::check_proof;
use zk0_circuits::Claim;
use zk0_protocol::entries::program::{Program, ProgramKey, OUR_SP1};
use zk0_protocol::quote::short;
use zk0_protocol::{Refusal, RefusalCode};

type CheckProof = fn(&[u8], &Claim, &ProgramKey) -> Result<(), Refusal>;

/// The verified releases of SP1, each with its verifier.
const VERIFIERS: [(&str, CheckProof); 1] = [(OUR_SP1, check_proof)];

/// Whether this build can verify the proofs of `program`.
pub fn can_verify(program: &Program) -> bool {
    verifier(program).is_ok()
}

/// The verified releases of SP1, as text.
pub fn releases() -> String {
    VERIFIERS.map(|(release, _)| release).join(", ")
}

/// Checks that `proof` proves `claim` under `program`, with the verifier of its SP1 release.
///
/// # Errors
/// The proof does not prove the claim, or the verifier is missing ([`RefusalCode::NoVerifier`]).
pub fn check_proof_of(program: &Program, proof: &[u8], claim: &Claim) -> Result<(), Refusal> {
    let key = ProgramKey::from_bytes(&program.key)
        .map_err(|error| RefusalCode::InvalidProof.because(error))?;
    verifier(program)?(proof, claim, &key)
}

fn verifier(program: &Program) -> Result<CheckProof, Refusal> {
    let known = VERIFIERS
        .iter()
        .find(|(release, _)| *release == program.sp1);
    known.map(|(_, check)| *check).ok_or_else(|| {
        RefusalCode::NoVerifier.because(format_args!("it is SP1 {}", short(&program.sp1)))
    })
}
