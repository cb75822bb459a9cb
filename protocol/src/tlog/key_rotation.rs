//! The log's key can change. The key that founds a network signs its checkpoints, until the operator gives the log another one. The founding
//! key is the operator's, and may then lie offline.
//!
//! From the entry that records the change on, the new key signs. Each of its checkpoints carries the operator's statement, as another line of
//! the note (C2SP signed-note, signature type `0xff`). So a reader who knows the founding key verifies every checkpoint alone. A replay
//! also requires the key that the entries determine ([`crate::log_keys`]), so a former key signs nothing later.

use crate::signed_statement::{SignableStatement, Signed};
use crate::tlog::names::MAX_NAME_BYTES;
use crate::tlog::verifier_key::VerifierKey;
use borsh::{BorshDeserialize, BorshSerialize};
use signed_note::{Note, Signature};
use zk0_circuits::{Digest, NodeId};

/// C2SP signed-note: a type of one's own has this byte and a name.
const SIGNATURE_TYPE: &[u8] = b"\xffzk0:log-key-rotation:v1";

/// Most bytes of an encoded, signed [`LogKeyRotation`].
pub const MAX_ROTATION_BYTES: usize = 3 * 32 + 4 + MAX_NAME_BYTES + 8 + 64;

/// The operator gives the log another key.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct LogKeyRotation {
    /// The network.
    pub network: Digest,
    /// The log's name, for readers who know only the log's founding key.
    pub log: String,
    /// The operator: the key that founded the network.
    pub operator: NodeId,
    /// The log's new key.
    pub with: NodeId,
    /// Index of the entry that records this, so that it is recorded once. Only checkpoints with that entry have the new key's signature.
    pub entry: u64,
}

/// The other half of a [`LogKeyRotation`], signed with the new key: the operator has it.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct LogKeyTakeover {
    /// The rotation.
    pub rotation: LogKeyRotation,
}

impl SignableStatement for LogKeyRotation {
    const TAG: &'static str = "zk0:log-key-rotation:v1";

    fn signer(&self) -> NodeId {
        self.operator
    }
}

impl SignableStatement for LogKeyTakeover {
    const TAG: &'static str = "zk0:log-key-takeover:v1";

    fn signer(&self) -> NodeId {
        self.rotation.with
    }
}

/// The line of a note that carries the operator's statement. `founding` is the log's founding key.
pub fn line(rotation: &Signed<LogKeyRotation>, founding: &VerifierKey) -> Signature {
    let bytes = borsh::to_vec(rotation).expect("writing to a Vec cannot fail");
    Signature::new(founding.name().into(), line_id(founding), bytes)
        .expect("the name was checked when the key was made")
}

/// The operator's statement on a note; `None` if it carries none.
///
/// # Errors
/// Why the statement does not count.
pub fn find(note: &Note, founding: &VerifierKey) -> Result<Option<Signed<LogKeyRotation>>, String> {
    let (bytes, id) = (note.to_bytes(), line_id(founding));
    let mut lines = bytes
        .split(|byte| *byte == b'\n')
        .filter_map(|line| Signature::from_bytes(line).ok());
    let Some(line) = lines.find(|line| line.name() == founding.name() && line.id() == id) else {
        return Ok(None);
    };
    let signed: Signed<LogKeyRotation> =
        borsh::from_slice(line.signature()).map_err(|error| error.to_string())?;
    let rotation = signed.verify().map_err(|error| error.to_string())?;
    if rotation.operator.0 != *founding.public() {
        return Err(format!(
            "{} has signed it, and not the key that founded the log",
            rotation.operator
        ));
    }
    if rotation.log != founding.name() {
        return Err("it is about another log".into());
    }
    Ok(Some(signed))
}

fn line_id(founding: &VerifierKey) -> u32 {
    let key = [SIGNATURE_TYPE, founding.public().as_slice()].concat();
    signed_note::key_id(founding.name(), &key)
}
