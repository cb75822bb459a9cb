//! Statements with their canonical encoding and ed25519 signature (RFC 8032).

use crate::public_key::public_key;
use borsh::{BorshDeserialize, BorshSerialize};
use ed25519_dalek::{Signature, Signer, SigningKey, VerifyingKey};
use zk0_circuits::NodeId;

/// A statement that names its signer.
pub trait SignableStatement: BorshSerialize + BorshDeserialize {
    /// Domain-separation tag: signatures are valid for one kind of statement.
    const TAG: &'static str;

    /// The required signer: a node, a governor, or the operator.
    fn signer(&self) -> NodeId;
}

/// A statement and its unverified signature: see [`Signed::verify`].
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Signed<T> {
    /// The statement.
    pub statement: T,
    /// ed25519 over `TAG ‖ 0x00 ‖ borsh(statement)`.
    pub signature: [u8; 64],
}

/// Why a signature is not valid.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SignatureError {
    /// The signer's identity is not a usable key.
    #[error("{0} is not an ed25519 public key")]
    BadKey(NodeId),
    /// The key did not make this signature.
    #[error("the signature is not node {0}'s signature of this {1}")]
    Mismatch(NodeId, &'static str),
}

impl<T: SignableStatement> Signed<T> {
    /// Signs `statement`. If `key` is not the signer's, the result never verifies.
    pub fn new(statement: T, key: &SigningKey) -> Self {
        let signature = key.sign(&message(&statement)).to_bytes();
        Self {
            statement,
            signature,
        }
    }

    /// Checks the signature, strictly (RFC 8032 without its malleable and small-order cases).
    pub fn verify(&self) -> Result<&T, SignatureError> {
        let node = self.statement.signer();
        self.verify_with(public_key(&node.0))
    }

    /// [`Signed::verify`] with the signer's decompressed key; `None` if unusable.
    pub(crate) fn verify_with(&self, key: Option<VerifyingKey>) -> Result<&T, SignatureError> {
        let node = self.statement.signer();
        let key = key.ok_or(SignatureError::BadKey(node))?;
        let signature = Signature::from_bytes(&self.signature);
        match key.verify_strict(&message(&self.statement), &signature) {
            Ok(()) => Ok(&self.statement),
            Err(_) => Err(SignatureError::Mismatch(node, T::TAG)),
        }
    }
}

fn message<T: SignableStatement>(statement: &T) -> Vec<u8> {
    let mut message = T::TAG.as_bytes().to_vec();
    message.push(0);
    statement
        .serialize(&mut message)
        .expect("writing to a Vec cannot fail");
    message
}
