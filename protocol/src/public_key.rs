//! ed25519 public keys.

use ed25519_dalek::VerifyingKey;

/// Reads an ed25519 public key; `None` if the bytes are not a point, or a point of small order, for which anybody can sign.
pub fn public_key(bytes: &[u8; 32]) -> Option<VerifyingKey> {
    let key = VerifyingKey::from_bytes(bytes).ok()?;
    (!key.is_weak()).then_some(key)
}
