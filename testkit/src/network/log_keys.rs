//! Other keys of the log.

use super::*;
use zk0_protocol::tlog::key_rotation::{LogKeyRotation, LogKeyTakeover};

/// The log's later keys, from 1 on.
pub fn later_key(number: u8) -> SigningKey {
    SigningKey::from_bytes(&[50 + number; 32])
}

/// A key's public half.
pub fn public(key: &SigningKey) -> NodeId {
    NodeId(key.verifying_key().to_bytes())
}

/// What the operator signs to give the log this key in the next entry.
pub fn log_rotation(state: &State, with: &SigningKey) -> LogKeyRotation {
    LogKeyRotation {
        network: *state.network(),
        log: state.genesis().name.clone(),
        operator: NodeId(state.genesis().log_key),
        with: public(with),
        entry: state.entries(),
    }
}

/// Signed by this operator, and by the new key.
pub fn log_rotated(rotation: LogKeyRotation, operator: &SigningKey, with: &SigningKey) -> Body {
    let takeover = LogKeyTakeover {
        rotation: rotation.clone(),
    };
    Body::LogKeyRotated {
        rotation: Signed::new(rotation, operator),
        takeover: Signed::new(takeover, with),
    }
}

/// The operator gives the log this key in the next entry.
pub fn log_rotated_to(state: &State, with: &SigningKey) -> Body {
    log_rotated(log_rotation(state, with), &log_key(), with)
}
