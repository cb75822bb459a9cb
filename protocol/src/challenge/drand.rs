//! drand, a public beacon: a group of operators signs one number every few seconds, and a signature is unknown before most of
//! them made it. The signature is unique and verifiable with the group's key.
//!
//! Only the scheme `bls-unchained-g1-rfc9380` of the network "quicknet" is supported: BLS signatures in G1 of BLS12-381 over the
//! SHA-256 of the round's number.

use bls12_381::hash_to_curve::{ExpandMsgXmd, HashToCurve};
use bls12_381::{pairing, G1Affine, G1Projective, G2Affine};
use borsh::{BorshDeserialize, BorshSerialize};
use serde::{Deserialize, Serialize};
use sha2::Sha256;
use zk0_circuits::vm::digest::sha256;

/// RFC 9380's domain-separation tag.
const DOMAIN: &[u8] = b"BLS_SIG_BLS12381G1_XMD:SHA-256_SSWU_RO_NUL_";

/// A beacon's signature, a compressed point of G1.
pub type BeaconSignature = [u8; 48];

/// A drand network, and how long after a closing its beacon must be.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DrandChain {
    /// The chain's hash, its name on drand's servers.
    #[serde(with = "hex::serde")]
    pub hash: [u8; 32],
    /// The group's public key, a compressed point of G2.
    #[serde(with = "hex::serde")]
    pub public_key: [u8; 96],
    /// When round 1 was signed, in Unix seconds.
    pub genesis_s: u64,
    /// Seconds between rounds.
    pub period_s: u64,
    /// The least time between the commitments' closing and the beacon's round, in milliseconds. If it exceeds the lag of the
    /// aggregator's clock, the beacon is unknown at the closing.
    pub margin_ms: u64,
}

impl DrandChain {
    /// The network "quicknet", as published by its operators, the League of Entropy.
    pub fn quicknet() -> Self {
        let mut public_key = [0; 96];
        let mut hash = [0; 32];
        let decoded = hex::decode_to_slice(QUICKNET_KEY, &mut public_key)
            .and_then(|()| hex::decode_to_slice(QUICKNET_HASH, &mut hash));
        decoded.expect("both texts are hexadecimal");
        Self {
            hash,
            public_key,
            genesis_s: 1_692_803_367,
            period_s: 3,
            margin_ms: 60_000,
        }
    }

    /// Checks every value. The error names a bad one.
    pub fn check(&self) -> Result<(), String> {
        if self.period_s == 0 {
            return Err("period_s is 0; it has to be at least 1".into());
        }
        match self.group_key() {
            Some(_) => Ok(()),
            None => Err(format!(
                "public_key {} is not a point of G2 of BLS12-381",
                hex::encode(self.public_key)
            )),
        }
    }

    /// The round that draws the randomness of commitments closed at `closed_ms` (Unix milliseconds): the first signed later than
    /// the margin after it.
    pub fn round_after(&self, closed_ms: u64) -> u64 {
        let latest_known_ms = closed_ms.saturating_add(self.margin_ms);
        let since_ms = latest_known_ms.checked_sub(self.genesis_s.saturating_mul(1000));
        match since_ms {
            None => 1,
            Some(since_ms) => {
                let period_ms = self.period_s.saturating_mul(1000).max(1);
                (since_ms / period_ms).saturating_add(2)
            }
        }
    }

    /// The longest wait from a closing to its beacon, in milliseconds.
    pub fn latest_after_closing_ms(&self) -> u64 {
        let period_ms = self.period_s.saturating_mul(1000);
        self.margin_ms.saturating_add(period_ms)
    }

    /// When a round is signed, in Unix milliseconds.
    pub fn time_ms(&self, round: u64) -> u64 {
        let after_s = round.saturating_sub(1).saturating_mul(self.period_s);
        self.genesis_s.saturating_add(after_s).saturating_mul(1000)
    }

    /// Whether `signature` is the group's for a round. Takes a few milliseconds.
    pub fn signed(&self, round: u64, signature: &BeaconSignature) -> bool {
        let point = Option::<G1Affine>::from(G1Affine::from_compressed(signature));
        let (Some(point), Some(group_key)) = (point, self.group_key()) else {
            return false;
        };
        let message = sha256(&[&round.to_be_bytes()]);
        let hashed = <G1Projective as HashToCurve<ExpandMsgXmd<Sha256>>>::hash_to_curve(
            [&message.0[..]],
            DOMAIN,
        );
        let signed = pairing(&point, &G2Affine::generator());
        signed == pairing(&hashed.into(), &group_key)
    }

    fn group_key(&self) -> Option<G2Affine> {
        let key = Option::<G2Affine>::from(G2Affine::from_compressed(&self.public_key))?;
        // Anybody can sign for the point at infinity.
        (!bool::from(key.is_identity())).then_some(key)
    }
}

const QUICKNET_HASH: &str = "52db9ba70e0cc0f6eaf7803dd07447a1f5477735fd3f661792ba94600c84e971";
const QUICKNET_KEY: &str = "83cf0f2896adee7eb8b5f01fcad3912212c437e0073e911fb90022d3e760183c\
    8c4b450b6a0a6c3ac6a5776a2d1064510d1fec758c921cc22b0e17e63aaf4bcb\
    5ed66304de9cf809bd274ca73bab4af5a6e9c76a4bc09e76eae8991ef5ece45a";
