//! ed25519 public keys.

use ed25519_dalek::VerifyingKey;

/// Reads an ed25519 public key. The result is `None` if the bytes are not a point of the curve, or if they are a point of small order,
/// because anybody can make signatures for such a key.
pub fn public_key(bytes: &[u8; 32]) -> Option<VerifyingKey> {
    let key = VerifyingKey::from_bytes(bytes).ok()?;
    (!key.is_weak()).then_some(key)
}
