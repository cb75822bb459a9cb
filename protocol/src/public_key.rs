//! ed25519 public keys.

use ed25519_dalek::VerifyingKey;

/// Reads an ed25519 public key. `None` when the bytes are not a point of the curve, or a point of small order: for such a key
/// anybody can make signatures.
pub fn public_key(bytes: &[u8; 32]) -> Option<VerifyingKey> {
    let key = VerifyingKey::from_bytes(bytes).ok()?;
    (!key.is_weak()).then_some(key)
}
