//! Verifies each proof before use, whatever made it.

use super::proof::Proof;
use sp1_sdk::SP1Proof;
use sp1_verifier::compressed::SP1CompressedVerifierRaw;

/// The proof to exchange, if SP1's verifier accepts it for the program with the verifying key `program`; otherwise, why not.
pub(crate) fn verified(
    program: &[u8; 32],
    proof: &SP1Proof,
    public_values: Vec<u8>,
) -> Result<Proof, String> {
    if !matches!(proof, SP1Proof::Compressed(_)) {
        return Err("it is not a compressed proof".into());
    }
    let bytes = bincode::serialize(proof).map_err(|error| error.to_string())?;
    SP1CompressedVerifierRaw::verify_with_public_values(&bytes, &public_values, program)
        .map_err(|error| error.to_string())?;
    Ok(Proof {
        bytes,
        public_values,
    })
}
