//! ed25519 public keys that were read once: what `ed25519_dalek::VerifyingKey::verify_strict` accepts, in less time.
//!
//! A key's 32 bytes are a compressed point, and decompressing it takes a tenth of a verification; a log has many signatures of
//! few keys. `verify_strict` decompresses the signature's R besides, to refuse points of small order. Verification compares R
//! with the encoding of a point that it computes, so an R that passes is that point's one encoding, and is of small order if
//! it is one of eight: comparing bytes says the same.

use ed25519_dalek::{Signature, Verifier, VerifyingKey};
use std::{
    cell::RefCell,
    collections::{hash_map::Entry, HashMap},
    sync::LazyLock,
};

/// Keys that each thread remembers, whoever made them up: as many as a table of 1,024 places holds, a quarter of a megabyte.
const REMEMBERED: usize = 896;

/// Encodings of the points of small order: signatures with them verify for messages that nobody signed.
static SMALL_ORDER: LazyLock<[[u8; 32]; 8]> =
    LazyLock::new(|| curve25519_dalek::constants::EIGHT_TORSION.map(|point| point.compress().0));

/// A point of the curve, not of small order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct PublicKey(VerifyingKey);

impl PublicKey {
    /// The key with these bytes, if they are one that nobody but its owner can sign for.
    pub fn from_bytes(bytes: &[u8; 32]) -> Option<Self> {
        thread_local! {
            static KNOWN: RefCell<HashMap<[u8; 32], PublicKey>> = RefCell::default();
        }
        KNOWN.with_borrow_mut(|known| {
            if known.len() >= REMEMBERED {
                known.clear();
            }
            match known.entry(*bytes) {
                Entry::Occupied(known) => Some(*known.get()),
                Entry::Vacant(place) => Self::decompress(bytes).map(|key| *place.insert(key)),
            }
        })
    }

    fn decompress(bytes: &[u8; 32]) -> Option<Self> {
        let key = VerifyingKey::from_bytes(bytes).ok()?;
        (!key.is_weak()).then_some(Self(key))
    }

    /// Whether the key's owner signed `message`: strictly (RFC 8032 with no malleable or small-order cases).
    pub fn verify(&self, message: &[u8], signature: &Signature) -> bool {
        !SMALL_ORDER.contains(signature.r_bytes()) && self.0.verify(message, signature).is_ok()
    }

    /// Its 32 bytes.
    pub fn as_bytes(&self) -> &[u8; 32] {
        self.0.as_bytes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use curve25519_dalek::{constants::EIGHT_TORSION, EdwardsPoint, Scalar};
    use proptest::prelude::*;
    use sha2::{Digest, Sha512};

    /// Whether dalek's own strict verification accepts, from the bytes on.
    fn strict(key: &[u8; 32], message: &[u8], signature: &Signature) -> bool {
        VerifyingKey::from_bytes(key).is_ok_and(|key| key.verify_strict(message, signature).is_ok())
    }

    fn ours(key: &[u8; 32], message: &[u8], signature: &Signature) -> bool {
        PublicKey::from_bytes(key).is_some_and(|key| key.verify(message, signature))
    }

    fn challenge(r: &[u8; 32], key: &[u8; 32], message: &[u8]) -> Scalar {
        let hash = Sha512::new().chain_update(r).chain_update(key);
        Scalar::from_bytes_mod_order_wide(&hash.chain_update(message).finalize().into())
    }

    proptest! {
        /// Signatures by somebody who chooses every part: secret, nonce, and points of small order added to key and R.
        #[test]
        fn accepts_what_strict_verification_accepts(
            secret in any::<[u8; 32]>(),
            nonce in prop_oneof![Just([0; 32]), any::<[u8; 32]>()],
            of_key in 0..8usize,
            of_r in 0..8usize,
            weak in any::<bool>(),
            message in any::<[u8; 9]>(),
            flipped in prop::option::of(0..768usize),
        ) {
            let secret = if weak { Scalar::ZERO } else { Scalar::from_bytes_mod_order(secret) };
            let nonce = Scalar::from_bytes_mod_order(nonce);
            let point = |scalar: &Scalar, torsion: usize| {
                (EdwardsPoint::mul_base(scalar) + EIGHT_TORSION[torsion]).compress().0
            };
            let mut key = point(&secret, of_key);
            let r = point(&nonce, of_r);
            let s = nonce + challenge(&r, &key, &message) * secret;
            let mut signature = [r, s.to_bytes()].concat();
            if let Some(bit) = flipped {
                let bytes = if bit < 512 { &mut signature[..] } else { &mut key[..] };
                bytes[bit % 512 / 8] ^= 1 << (bit % 8);
            }
            let signature = Signature::from_slice(&signature).unwrap();
            prop_assert_eq!(ours(&key, &message, &signature), strict(&key, &message, &signature));
        }
    }

    /// Whoever has the key can sign with an R that is no nonce's; plain verification accepts that.
    #[test]
    fn r_of_small_order_is_refused() {
        let secret = Scalar::from(7u64);
        let key = EdwardsPoint::mul_base(&secret).compress().0;
        let r = EIGHT_TORSION[0].compress().0;
        let s = challenge(&r, &key, b"message") * secret;
        let signature = Signature::from_components(r, s.to_bytes());
        let plain = VerifyingKey::from_bytes(&key).unwrap();
        assert!(plain.verify(b"message", &signature).is_ok());
        assert!(!ours(&key, b"message", &signature));
    }

    #[test]
    fn more_keys_than_are_remembered_do_no_harm() {
        for number in 1..=REMEMBERED as u64 + 10 {
            let key = EdwardsPoint::mul_base(&Scalar::from(number)).compress().0;
            assert_eq!(PublicKey::from_bytes(&key).unwrap().as_bytes(), &key);
        }
        let key = EdwardsPoint::mul_base(&Scalar::from(3u64)).compress().0;
        assert!(PublicKey::from_bytes(&key).is_some());
    }
}
