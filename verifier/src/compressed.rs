//! SP1's verification of a compressed proof, over a faster permutation.
//!
//! The shard proof is verified by SP1's own code, which takes the hash function as a parameter; [`Context`] gives it
//! [`Poseidon2`]. What its `SP1CompressedVerifier`, which takes no parameter, checks around the shard proof is checked here,
//! under the same names. The tests hold every check, and both verifiers' verdicts, side by side.

use crate::poseidon2::Poseidon2;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use slop_algebra::{extension::BinomialExtensionField, AbstractField, PrimeField32};
use slop_challenger::{DuplexChallenger, IopCtx};
use slop_symmetric::{CryptographicHasher, PaddingFreeSponge, TruncatedPermutation};
use sp1_hypercube::{
    verify_merkle_proof, HashableKey, MachineVerifier, MerkleProof, SP1PcsProof, SP1RecursionProof,
    ShardVerifier, DIGEST_SIZE, SP1SC,
};
use sp1_primitives::{
    fri_params::recursion_fri_config, poseidon2_hasher, SP1Field, SP1GlobalContext,
};
use sp1_recursion_executor::{RecursionPublicValues, NUM_PV_ELMS_TO_HASH};
use sp1_verifier::{
    compressed::{RECURSION_LOG_STACKING_HEIGHT, RECURSION_MAX_LOG_ROW_COUNT},
    VerifierRecursionVks,
};
use std::borrow::Borrow;

/// What SP1's proofs are made over: as its `SP1GlobalContext`, but for the code of the permutation.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Context;

impl IopCtx for Context {
    type F = SP1Field;
    type EF = BinomialExtensionField<SP1Field, 4>;
    type Digest = [SP1Field; DIGEST_SIZE];
    type Challenger = DuplexChallenger<SP1Field, Poseidon2, 16, 8>;
    type Hasher = PaddingFreeSponge<Poseidon2, 16, 8, DIGEST_SIZE>;
    type Compressor = TruncatedPermutation<Poseidon2, 2, DIGEST_SIZE, 16>;

    fn default_hasher_and_compressor() -> (Self::Hasher, Self::Compressor) {
        (
            Self::Hasher::new(Poseidon2),
            Self::Compressor::new(Poseidon2),
        )
    }

    fn default_challenger() -> Self::Challenger {
        DuplexChallenger::new(Poseidon2)
    }
}

/// A compressed proof. Its encoding is that of SP1's.
pub type CompressedProof = SP1RecursionProof<Context, SP1PcsProof<Context>>;

/// The machine that verifies proofs inside a proof, as SP1 6.10 compresses with it.
type CompressAir = sp1_recursion_machine::RecursionAir<SP1Field, 3, 2>;

/// Why a compressed proof does not hold.
#[derive(Debug, thiserror::Error)]
pub enum Rejected {
    /// The shard proof itself.
    #[error("invalid shard proof: {0}")]
    Shard(String),
    /// The program ended with an error.
    #[error("the program's exit code is {0}")]
    ExitCode(u32),
    /// The public values do not hash to their digest.
    #[error("recursion public values are invalid")]
    PublicValuesDigest,
    /// The proof was made by another recursion program than SP1's.
    #[error("incorrect vkey")]
    RecursionKey,
    /// The proof admits other recursion programs than SP1's.
    #[error("vk merkle root mismatch")]
    RecursionKeysRoot,
    /// Part of the execution is not proven.
    #[error("is_complete is not 1")]
    Incomplete,
    /// Valid, of another program.
    #[error("sp1 vk hash mismatch")]
    Program,
    /// Valid, of this program, with other public values.
    #[error("given public values do not match the commitment in the proof")]
    PublicValues,
}

/// Verifies compressed proofs. Building it takes milliseconds; it is built once.
pub struct CompressedVerifier {
    shards: MachineVerifier<Context, SP1SC<Context, CompressAir>>,
    recursion_keys: RecursionKeys,
}

/// SP1's recursion programs: the tree of their verifying keys.
struct RecursionKeys {
    root: [SP1Field; DIGEST_SIZE],
    count: usize,
}

impl CompressedVerifier {
    /// The verifier of this release of SP1.
    pub fn new() -> Self {
        let keys = VerifierRecursionVks::default();
        Self {
            shards: MachineVerifier::new(ShardVerifier::from_basefold_parameters(
                recursion_fri_config(),
                RECURSION_LOG_STACKING_HEIGHT,
                RECURSION_MAX_LOG_ROW_COUNT,
                CompressAir::compress_machine(),
            )),
            recursion_keys: RecursionKeys {
                root: keys.root(),
                count: keys.num_keys(),
            },
        }
    }

    /// Checks that `proof` proves an execution of the program whose verifying key hashes to `program`, that ended well and
    /// committed to `public_values` (by SHA-256).
    pub fn verify(
        &self,
        proof: &CompressedProof,
        public_values: &[u8],
        program: &[SP1Field; DIGEST_SIZE],
    ) -> Result<(), Rejected> {
        let mut challenger = self.shards.challenger();
        proof.vk.observe_into(&mut challenger);
        // This includes that there are as many public values as `RecursionPublicValues` has.
        self.shards
            .verify_shard(&proof.vk, &proof.proof, &mut challenger)
            .map_err(|error| Rejected::Shard(error.to_string()))?;
        let recursion: &RecursionPublicValues<SP1Field> =
            proof.proof.public_values.as_slice().borrow();
        self.recursion_keys
            .check(&proof.vk_merkle_proof, proof.vk.hash_koalabear())?;
        check_values(recursion, &self.recursion_keys, public_values, program)
    }
}

impl Default for CompressedVerifier {
    fn default() -> Self {
        Self::new()
    }
}

impl RecursionKeys {
    /// Checks that `proof` leads from `key`, a verifying key's hash, to the root.
    fn check(
        &self,
        proof: &MerkleProof<SP1GlobalContext>,
        key: [SP1Field; DIGEST_SIZE],
    ) -> Result<(), Rejected> {
        // A key beyond the last is padding.
        if proof.index >= self.count
            || proof.path.len() != self.count.next_power_of_two().ilog2() as usize
        {
            return Err(Rejected::RecursionKey);
        }
        verify_merkle_proof(proof, key, self.root).map_err(|_| Rejected::RecursionKey)
    }
}

/// Checks what a valid shard proof says of itself.
fn check_values(
    values: &RecursionPublicValues<SP1Field>,
    keys: &RecursionKeys,
    public_values: &[u8],
    program: &[SP1Field; DIGEST_SIZE],
) -> Result<(), Rejected> {
    if values.exit_code != SP1Field::zero() {
        return Err(Rejected::ExitCode(values.exit_code.as_canonical_u32()));
    }
    if values.digest != digest(values) {
        return Err(Rejected::PublicValuesDigest);
    }
    if values.vk_root != keys.root {
        return Err(Rejected::RecursionKeysRoot);
    }
    if values.is_complete != SP1Field::one() {
        return Err(Rejected::Incomplete);
    }
    if values.sp1_vk_digest != *program {
        return Err(Rejected::Program);
    }
    let committed = values.committed_value_digest.as_flattened();
    let expected = Sha256::digest(public_values);
    if !committed
        .iter()
        .copied()
        .eq(expected.into_iter().map(SP1Field::from_canonical_u8))
    {
        return Err(Rejected::PublicValues);
    }
    Ok(())
}

fn digest(values: &RecursionPublicValues<SP1Field>) -> [SP1Field; DIGEST_SIZE] {
    poseidon2_hasher().hash_slice(&values.as_array()[..NUM_PV_ELMS_TO_HASH])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of a complete execution, as the recursion program would state it.
    fn complete(keys: &RecursionKeys) -> RecursionPublicValues<SP1Field> {
        let committed = Sha256::digest(b"claim");
        let mut values = RecursionPublicValues {
            sp1_vk_digest: [SP1Field::two(); DIGEST_SIZE],
            vk_root: keys.root,
            is_complete: SP1Field::one(),
            ..Default::default()
        };
        for (element, byte) in values
            .committed_value_digest
            .as_flattened_mut()
            .iter_mut()
            .zip(committed)
        {
            *element = SP1Field::from_canonical_u8(byte);
        }
        values.digest = digest(&values);
        values
    }

    /// The verdict on [`complete`], changed, with its digest made anew.
    fn verdict(change: impl FnOnce(&mut RecursionPublicValues<SP1Field>)) -> Result<(), Rejected> {
        let keys = CompressedVerifier::new().recursion_keys;
        let mut values = complete(&keys);
        change(&mut values);
        values.digest = digest(&values);
        check_values(&values, &keys, b"claim", &[SP1Field::two(); DIGEST_SIZE])
    }

    #[test]
    fn every_public_value_that_is_read_is_checked() {
        let two = SP1Field::two();
        assert!(verdict(|_| ()).is_ok());
        assert!(matches!(
            verdict(|values| values.exit_code = two),
            Err(Rejected::ExitCode(2))
        ));
        assert!(matches!(
            verdict(|values| values.vk_root[7] += two),
            Err(Rejected::RecursionKeysRoot)
        ));
        for other in [SP1Field::zero(), two] {
            assert!(matches!(
                verdict(|values| values.is_complete = other),
                Err(Rejected::Incomplete)
            ));
        }
        assert!(matches!(
            verdict(|values| values.sp1_vk_digest[7] += two),
            Err(Rejected::Program)
        ));
        assert!(matches!(
            verdict(|values| values.committed_value_digest[7][3] += two),
            Err(Rejected::PublicValues)
        ));
        // The same byte, of an element that is none.
        assert!(matches!(
            verdict(
                |values| values.committed_value_digest[0][0] += SP1Field::from_canonical_u32(256)
            ),
            Err(Rejected::PublicValues)
        ));
    }

    #[test]
    fn public_values_that_do_not_hash_to_their_digest_are_rejected() {
        let keys = CompressedVerifier::new().recursion_keys;
        let mut values = complete(&keys);
        values.pc_start[0] += SP1Field::one();
        assert!(matches!(
            check_values(&values, &keys, b"claim", &values.sp1_vk_digest),
            Err(Rejected::PublicValuesDigest)
        ));
    }

    #[test]
    fn a_recursion_key_has_to_be_in_the_tree() {
        // A tree of three keys, the fourth leaf padding.
        let (_, compressor) = SP1GlobalContext::default_hasher_and_compressor();
        let pair = |a, b| slop_symmetric::PseudoCompressionFunction::compress(&compressor, [a, b]);
        let leaves: [[SP1Field; DIGEST_SIZE]; 4] =
            std::array::from_fn(|i| [SP1Field::from_canonical_usize(i); DIGEST_SIZE]);
        // Leaves lie in the order of their indexes' bits reversed.
        let (left, right) = (pair(leaves[0], leaves[2]), pair(leaves[1], leaves[3]));
        let keys = RecursionKeys {
            root: pair(left, right),
            count: 3,
        };
        let proof = |index, path: &[_]| MerkleProof::<SP1GlobalContext> {
            index,
            path: path.to_vec(),
        };
        assert!(keys.check(&proof(1, &[leaves[3], left]), leaves[1]).is_ok());
        for (wrong, key) in [
            (proof(1, &[leaves[3], left]), leaves[0]),
            (proof(0, &[leaves[3], left]), leaves[1]),
            (proof(1, &[leaves[2], left]), leaves[1]),
            // Each would lead to the root.
            (proof(3, &[leaves[1], left]), leaves[3]),
            (proof(5, &[leaves[3], left]), leaves[1]),
            (proof(1, &[left]), right),
            (proof(0, &[]), keys.root),
        ] {
            assert!(matches!(
                keys.check(&wrong, key),
                Err(Rejected::RecursionKey)
            ));
        }
    }
}
