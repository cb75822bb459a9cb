//! Checks an SP1 compressed proof in process, without `sp1-sdk`.
//!
//! A proof is `bincode(SP1Proof::Compressed(…))`, its public values are `borsh(Claim)`. Strangers send these bytes, so they are
//! decoded under a limit and must be canonical. A panic inside SP1's verifier refuses the proof and does not end the process.

use bincode::Options;
use sp1_verifier::compressed::{CompressedError, SP1CompressedVerifier};
use sp1_verifier::SP1Proof;
use std::io;
use std::panic::{catch_unwind, AssertUnwindSafe};
use std::sync::LazyLock;
use zk0_circuits::Claim;
use zk0_protocol::entries::program::ProgramKey;
use zk0_protocol::quote::short;
use zk0_protocol::{Refusal, RefusalCode};

/// Index of `SP1Proof::Compressed` in its encoding; 0 is core, 2 PLONK, 3 Groth16.
const COMPRESSED: u32 = 1;

/// Checks that `proof` proves `claim` under the program `key`. About 50 ms.
pub fn check_proof(proof: &[u8], claim: &Claim, key: &ProgramKey) -> Result<(), Refusal> {
    let public_values =
        borsh::to_vec(claim).map_err(|error| RefusalCode::InvalidProof.because(error))?;
    refuse_panics(|| {
        let decoded = decode(proof)?;
        verify(&decoded, &public_values, key)
    })
}

/// Refuses the proof if SP1's verifier panics: it is a large program that reads hostile bytes.
fn refuse_panics(check: impl FnOnce() -> Result<(), Refusal>) -> Result<(), Refusal> {
    catch_unwind(AssertUnwindSafe(check)).unwrap_or_else(|_| {
        tracing::error!("SP1's verifier panicked on a proof; the proof is refused");
        Err(RefusalCode::InvalidProof.because("SP1's verifier gave up on it"))
    })
}

fn decode(bytes: &[u8]) -> Result<SP1Proof, Refusal> {
    let malformed = |cause: String| RefusalCode::MalformedProof.because(short(&cause));
    let kind = bytes
        .first_chunk::<4>()
        .ok_or_else(|| malformed(format!("{} bytes are too few", bytes.len())))?;
    match u32::from_le_bytes(*kind) {
        COMPRESSED => {}
        0 => return Err(malformed("it is a core proof".into())),
        2 => return Err(malformed("it is a PLONK proof".into())),
        3 => return Err(malformed("it is a Groth16 proof".into())),
        other => return Err(malformed(format!("unknown kind of proof {other}"))),
    }
    let encoding = bincode::DefaultOptions::new().with_fixint_encoding();
    let proof: SP1Proof = encoding
        .with_limit(bytes.len() as u64)
        .reject_trailing_bytes()
        .deserialize(bytes)
        .map_err(|error| malformed(error.to_string()))?;
    // Field elements above the modulus and repeated map keys decode, but are a second encoding.
    let mut rest = ExpectedBytes(bytes);
    match encoding.serialize_into(&mut rest, &proof) {
        Ok(()) if rest.0.is_empty() => Ok(proof),
        _ => Err(malformed("not in canonical encoding".into())),
    }
}

/// A writer that accepts only the expected bytes.
struct ExpectedBytes<'a>(&'a [u8]);

impl io::Write for ExpectedBytes<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0 = self
            .0
            .strip_prefix(bytes)
            .ok_or(io::ErrorKind::InvalidData)?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

fn verify(proof: &SP1Proof, public_values: &[u8], key: &ProgramKey) -> Result<(), Refusal> {
    static VERIFIER: LazyLock<SP1CompressedVerifier> = LazyLock::new(SP1CompressedVerifier::new);

    let SP1Proof::Compressed(proof) = proof else {
        return Err(RefusalCode::MalformedProof.because(format_args!("it is a {proof} proof")));
    };
    let key = bincode::deserialize(key.as_bytes())
        .map_err(|error| RefusalCode::InvalidProof.because(short(&error.to_string())))?;
    VERIFIER
        .verify_compressed_with_public_values(proof, public_values, &key)
        .map_err(|error| match error {
            CompressedError::PublicValuesMismatch => RefusalCode::OtherClaim.into(),
            other => match other.to_string() {
                // The last check before the public values: the proof is valid for another program.
                text if text.ends_with("sp1 vk hash mismatch") => RefusalCode::OtherProgram.into(),
                text => RefusalCode::InvalidProof.because(short(&text)),
            },
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_a_refusal() {
        let refused = refuse_panics(|| panic!("index out of bounds"));
        assert_eq!(refused, Err(RefusalCode::InvalidProof.into()));
    }
}
