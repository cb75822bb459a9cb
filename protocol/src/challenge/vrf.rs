//! ECVRF-EDWARDS25519-SHA512-TAI (RFC 9381): a verifiable random function of an ed25519 key. Only the owner of the secret key can
//! compute an input's unique output, and anybody can verify the proof.
//!
//! This follows RFC 9381, section 5, and its test vectors: no maintained crate has it for ed25519-dalek's release of
//! curve25519-dalek.
//!
//! The log's key also signs checkpoints. Both derive nonces from the same secret prefix: ed25519 from the message, this function
//! from a point of 32 bytes. A checkpoint is always longer, so no nonce is used twice.

use crate::public_key::public_key;
use borsh::{BorshDeserialize, BorshSerialize};
use curve25519_dalek::edwards::{CompressedEdwardsY, EdwardsPoint};
use curve25519_dalek::scalar::Scalar;
use curve25519_dalek::traits::IsIdentity;
use ed25519_dalek::SigningKey;
use sha2::{Digest as _, Sha512};
use std::fmt;

/// The suite's number in RFC 9381, section 5.5.
const SUITE: u8 = 0x03;

/// Bytes of a proof's hash (`cLen`).
const HASH_BYTES: usize = 16;

/// A proof in the RFC's encoding: a point, a hash of 16 bytes, and a scalar.
#[derive(Clone, Copy, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct VrfProof(pub [u8; 80]);

/// The function's output.
pub type VrfOutput = [u8; 64];

impl VrfProof {
    /// Computes and proves the function of `key` for `input`.
    pub fn of(key: &SigningKey, input: &[u8]) -> Self {
        let public = key.verifying_key().to_bytes();
        let point = to_curve(&public, input);
        let secret = key.to_scalar();
        let gamma = secret * point;
        // RFC 9381, section 5.4.2.2: the nonce depends on the point and on the second half of the expanded secret key.
        let expanded = Sha512::digest(key.as_bytes());
        let nonce = Sha512::new()
            .chain_update(&expanded[32..])
            .chain_update(point.compress().as_bytes());
        let nonce = Scalar::from_bytes_mod_order_wide(&nonce.finalize().into());
        let shown = [
            CompressedEdwardsY(public),
            point.compress(),
            gamma.compress(),
            EdwardsPoint::mul_base(&nonce).compress(),
            (nonce * point).compress(),
        ];
        let hash = proof_hash(&shown);
        let answer = nonce + scalar(&hash) * secret;
        let mut bytes = [0; 80];
        bytes[..32].copy_from_slice(gamma.compress().as_bytes());
        bytes[32..48].copy_from_slice(&hash);
        bytes[48..].copy_from_slice(answer.as_bytes());
        Self(bytes)
    }

    /// The proven output, if the proof is valid.
    pub fn output(&self) -> Option<VrfOutput> {
        self.parts().map(|(gamma, ..)| output(&gamma))
    }

    /// The output for `input`, if this proves one for the public key `key`.
    pub fn verify(&self, key: &[u8; 32], input: &[u8]) -> Option<VrfOutput> {
        // Anybody knows the output for a key of small order.
        let public = public_key(key)?.to_edwards();
        let (gamma, hash, answer) = self.parts()?;
        let point = to_curve(key, input);
        let minus_hash = -scalar(&hash);
        let shown = [
            CompressedEdwardsY(*key),
            point.compress(),
            gamma.compress(),
            (EdwardsPoint::mul_base(&answer) + minus_hash * public).compress(),
            (answer * point + minus_hash * gamma).compress(),
        ];
        (proof_hash(&shown) == hash).then(|| output(&gamma))
    }

    fn parts(&self) -> Option<(EdwardsPoint, [u8; HASH_BYTES], Scalar)> {
        let (gamma, rest) = self.0.split_first_chunk()?;
        let (hash, answer) = rest.split_first_chunk()?;
        let answer = Scalar::from_canonical_bytes(answer.try_into().ok()?).into_option()?;
        Some((canonical_point(gamma)?, *hash, answer))
    }
}

impl fmt::Debug for VrfProof {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "VrfProof({})", hex::encode(self.0))
    }
}

/// `ECVRF_proof_to_hash`. It uses only the point, which the key and the input determine.
fn output(gamma: &EdwardsPoint) -> VrfOutput {
    let hash = Sha512::new()
        .chain_update([SUITE, 0x03])
        .chain_update(gamma.mul_by_cofactor().compress().as_bytes())
        .chain_update([0x00]);
    hash.finalize().into()
}

/// `ECVRF_encode_to_curve_try_and_increment`: hashes until the hash is a point.
fn to_curve(salt: &[u8; 32], input: &[u8]) -> EdwardsPoint {
    let tries = (0..=u8::MAX).find_map(|counter| {
        let hash = Sha512::new()
            .chain_update([SUITE, 0x01])
            .chain_update(salt)
            .chain_update(input)
            .chain_update([counter, 0x00])
            .finalize();
        let point = canonical_point(hash.first_chunk()?)?.mul_by_cofactor();
        (!point.is_identity()).then_some(point)
    });
    // 256 hashes without a point do not occur.
    tries.unwrap_or_default()
}

/// A point from its only encoding: the curve's crate also reads encodings that RFC 8032 refuses.
fn canonical_point(bytes: &[u8; 32]) -> Option<EdwardsPoint> {
    let encoded = CompressedEdwardsY(*bytes);
    let point = encoded.decompress()?;
    (point.compress() == encoded).then_some(point)
}

/// `ECVRF_challenge_generation`.
fn proof_hash(points: &[CompressedEdwardsY; 5]) -> [u8; HASH_BYTES] {
    let mut hash = Sha512::new().chain_update([SUITE, 0x02]);
    for point in points {
        hash.update(point.as_bytes());
    }
    hash.update([0x00]);
    let mut short = [0; HASH_BYTES];
    short.copy_from_slice(&hash.finalize()[..HASH_BYTES]);
    short
}

fn scalar(hash: &[u8; HASH_BYTES]) -> Scalar {
    Scalar::from(u128::from_le_bytes(*hash))
}
