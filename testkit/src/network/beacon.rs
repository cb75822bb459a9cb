//! A drand network whose one key signs every round.

use bls12_381::hash_to_curve::{ExpandMsgXmd, HashToCurve};
use bls12_381::{G1Affine, G1Projective, G2Affine, Scalar};
use sha2::Sha256;
use zk0_circuits::vm::digest::sha256;
use zk0_protocol::challenge::drand::{BeaconSignature, DrandChain};

/// A network by its secret key.
pub struct Beacon(u64);

impl Beacon {
    /// With this key.
    pub fn new(secret: u64) -> Self {
        Self(secret)
    }

    /// For the rules. Round 1 was signed at `genesis_s`.
    pub fn chain(&self, genesis_s: u64, margin_ms: u64) -> DrandChain {
        let key = G2Affine::generator() * Scalar::from(self.0);
        DrandChain {
            hash: [self.0 as u8; 32],
            public_key: G2Affine::from(key).to_compressed(),
            genesis_s,
            period_s: 3,
            margin_ms,
        }
    }

    /// A round's signature.
    pub fn sign(&self, round: u64) -> BeaconSignature {
        let message = sha256(&[&round.to_be_bytes()]);
        let hashed = <G1Projective as HashToCurve<ExpandMsgXmd<Sha256>>>::hash_to_curve(
            [&message.0[..]],
            b"BLS_SIG_BLS12381G1_XMD:SHA-256_SSWU_RO_NUL_",
        );
        G1Affine::from(hashed * Scalar::from(self.0)).to_compressed()
    }
}
