//! The ledger's record of a round's randomness. Each replay verifies it, and each node before it makes a claim.

use crate::challenge::closing::CommitmentsClosing;
use crate::challenge::drand::BeaconSignature;
use crate::challenge::source::RandomnessSource;
use crate::challenge::vrf::VrfProof;
use crate::rules::network_rules::Rules;
use crate::tlog::checkpoint::{Checkpoint, CheckpointError};
use borsh::{BorshDeserialize, BorshSerialize};
use std::fmt;
use zk0_circuits::vm::digest::{sha256, tagged_sha256};
use zk0_circuits::Digest;

/// A cosignature as in notes: POSIX seconds (8 bytes, big-endian) and an ed25519 signature.
pub type Cosignature = [u8; 72];

/// The randomness, with the evidence of its source.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub enum Drawing {
    /// The proof of the log's verifiable random function for the commitments.
    LogVrf(VrfProof),
    /// The cosignatures of the checkpoint that ends with the closing, in the order of the rules' witnesses.
    Witnesses(Vec<Cosignature>),
    /// A beacon.
    Drand {
        /// The beacon's round.
        round: u64,
        /// The round's signature.
        signature: BeaconSignature,
    },
}

/// Why a round's randomness is refused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RandomnessError {
    /// The source is not the one in the rules.
    #[error("it comes from {found}, but the rules ask for {expected}")]
    OtherSource {
        found: &'static str,
        expected: String,
    },
    /// The proof of the log's function does not verify.
    #[error("the proof is not the proof of the log's key for the commitments {0}")]
    Vrf(Digest),
    /// The closing determines another round of the beacon.
    #[error(
        "the beacon is of drand round {found}, but the closing of the commitments determines round {expected}"
    )]
    OtherRound { found: u64, expected: u64 },
    /// The beacon's signature does not verify.
    #[error("the signature of drand round {round} does not verify with the public key in the rules, that of chain {chain}")]
    BeaconSignature { round: u64, chain: String },
    /// The entry's time is before the beacon's.
    #[error("the entry's time is {early_ms} ms before drand signs round {round}")]
    BeforeBeacon { round: u64, early_ms: u64 },
    /// The rules name no witnesses, or the log's name is unusable.
    #[error("the closing cannot be cosigned: {0}")]
    NoCheckpoint(String),
    /// Not one cosignature for each witness.
    #[error("there are {found} cosignatures, but the rules name {expected} witnesses, and all of them have to cosign the closing")]
    OtherCount { found: usize, expected: usize },
    /// A cosignature does not verify.
    #[error("the cosignature of witness {witness} is not one of the checkpoint of {size} entries with root {root}")]
    BadCosignature {
        witness: String,
        size: u64,
        root: Digest,
    },
}

impl From<CheckpointError> for RandomnessError {
    fn from(error: CheckpointError) -> Self {
        Self::NoCheckpoint(error.to_string())
    }
}

/// What a drawing is verified against.
#[derive(Clone, Copy, Debug)]
pub struct DrawContext<'a> {
    /// The rules in force, with the source.
    pub rules: &'a Rules,
    /// The log's name.
    pub origin: &'a str,
    /// The log's key.
    pub log_key: &'a [u8; 32],
    /// How the commitments closed.
    pub closing: &'a CommitmentsClosing,
    /// When the drawing is recorded, in Unix milliseconds.
    pub recorded_ms: u64,
}

impl Drawing {
    /// The randomness, if well-formed. Only [`Drawing::verify`] checks it.
    pub fn value(&self) -> Option<Digest> {
        match self {
            Self::LogVrf(proof) => {
                let output = proof.output()?;
                Some(tagged_sha256("zk0/randomness-of-vrf/v1", &[&output]))
            }
            Self::Witnesses(cosignatures) => {
                let parts: Vec<&[u8]> = cosignatures.iter().map(|bytes| &bytes[..]).collect();
                Some(tagged_sha256("zk0/randomness-of-witnesses/v1", &parts))
            }
            // As drand publishes it.
            Self::Drand { signature, .. } => Some(sha256(&[signature])),
        }
    }

    /// Checks the drawing against the rules and this closing.
    pub fn verify(&self, context: &DrawContext<'_>) -> Result<(), RandomnessError> {
        let closing = context.closing;
        match (self, &context.rules.randomness) {
            (Self::LogVrf(proof), RandomnessSource::LogVrf) => {
                let output = proof.verify(context.log_key, &closing.commitments.0);
                output
                    .map(drop)
                    .ok_or(RandomnessError::Vrf(closing.commitments))
            }
            (Self::Drand { round, signature }, RandomnessSource::Drand(chain)) => {
                let expected = chain.round_after(closing.time_ms);
                if *round != expected {
                    return Err(RandomnessError::OtherRound {
                        found: *round,
                        expected,
                    });
                }
                let early_ms = chain.time_ms(expected).saturating_sub(context.recorded_ms);
                if early_ms > 0 {
                    return Err(RandomnessError::BeforeBeacon {
                        round: expected,
                        early_ms,
                    });
                }
                if chain.signed(expected, signature) {
                    Ok(())
                } else {
                    Err(RandomnessError::BeaconSignature {
                        round: expected,
                        chain: hex::encode(chain.hash),
                    })
                }
            }
            (Self::Witnesses(cosignatures), RandomnessSource::Witnesses) => {
                check_cosigned(cosignatures, context)
            }
            (drawing, source) => Err(RandomnessError::OtherSource {
                found: drawing.source(),
                expected: source.to_string(),
            }),
        }
    }

    fn source(&self) -> &'static str {
        match self {
            Self::LogVrf(_) => "a VRF",
            Self::Witnesses(_) => "cosignatures",
            Self::Drand { .. } => "a drand beacon",
        }
    }
}

impl fmt::Display for Drawing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::LogVrf(_) => f.write_str("the VRF of the log's key"),
            Self::Witnesses(all) => write!(f, "the cosignatures of {} witnesses", all.len()),
            Self::Drand { round, .. } => write!(f, "drand round {round}"),
        }
    }
}

/// Checks that all witnesses cosigned the checkpoint that ends with the closing.
fn check_cosigned(
    cosignatures: &[Cosignature],
    context: &DrawContext<'_>,
) -> Result<(), RandomnessError> {
    let policy = context
        .rules
        .witnesses()
        .map_err(RandomnessError::NoCheckpoint)?;
    let witnesses = policy.witnesses();
    if cosignatures.len() != witnesses.len() || witnesses.is_empty() {
        return Err(RandomnessError::OtherCount {
            found: cosignatures.len(),
            expected: witnesses.len(),
        });
    }
    let checkpoint = Checkpoint {
        size: context.closing.entry.saturating_add(1),
        root: context.closing.root,
    };
    let text = checkpoint.text(context.origin)?;
    for (witness, cosignature) in witnesses.iter().zip(cosignatures) {
        if witness.key.cosigned_at(&text, cosignature).is_none() {
            return Err(RandomnessError::BadCosignature {
                witness: witness.name.clone(),
                size: checkpoint.size,
                root: checkpoint.root,
            });
        }
    }
    Ok(())
}
