//! Entries with one byte changed.

use super::steps::sign;
use zk0_protocol::entries::signed::SignableStatement;
use zk0_protocol::{Body, Signed};

/// Returns the same entry with one byte changed. Signed parts are signed again, so that the rules have to notice the change.
pub fn bent(body: Body, at: u16, with: u8) -> Body {
    let flip = |mut bytes: Vec<u8>| {
        let at = usize::from(at) % bytes.len();
        bytes[at] ^= with;
        bytes
    };
    fn again<T: SignableStatement>(
        signed: Signed<T>,
        flip: impl Fn(Vec<u8>) -> Vec<u8>,
    ) -> Signed<T> {
        let bytes = borsh::to_vec(&signed.statement).unwrap();
        borsh::from_slice(&flip(bytes)).map_or(signed, sign)
    }
    match body {
        Body::DatasetCommitted(signed) => Body::DatasetCommitted(again(signed, flip)),
        Body::UpdateCommitted(signed) => Body::UpdateCommitted(again(signed, flip)),
        Body::ContributionAccepted(signed) => Body::ContributionAccepted(again(signed, flip)),
        Body::ContributionRejected { submission, reason } => Body::ContributionRejected {
            submission: again(submission, flip),
            reason,
        },
        Body::KeyRotated { rotation, takeover } => match with % 2 {
            0 => Body::KeyRotated {
                rotation: again(rotation, flip),
                takeover,
            },
            _ => Body::KeyRotated {
                rotation,
                takeover: again(takeover, flip),
            },
        },
        Body::Proposed(signed) => Body::Proposed(again(signed, flip)),
        Body::Voted(signed) => Body::Voted(again(signed, flip)),
        Body::Disputed(signed) => Body::Disputed(again(signed, flip)),
        unsigned => borsh::from_slice(&flip(borsh::to_vec(&unsigned).unwrap())).unwrap_or(unsigned),
    }
}
