//! The network's beginning.

use super::{digest, weights, ManualClock, SigningNode, EVALUATION_FRAMES};
use ed25519_dalek::SigningKey;
use std::io::{self, Write};
use std::path::Path;
use std::sync::Arc;
use zk0_aggregator::round::founding::Founding;
use zk0_aggregator::round::request_error::RequestError;
use zk0_aggregator::{Aggregator, Config};
use zk0_circuits::claim::program::verifying_key;
use zk0_circuits::{EvalSpec, Mode};
use zk0_protocol::entries::genesis::Genesis;
use zk0_protocol::rules::closing::credits::CreditRule;
use zk0_protocol::rules::governance::{Governance, Governor};
use zk0_protocol::rules::network_rules::Rules;
use zk0_verifier::blob_digest;

/// When networks begin.
pub const START_MS: u64 = 1_700_000_000_000;
/// Seed of the governor's key.
pub const GOVERNOR: u8 = 99;
/// Time for votes.
pub const VOTING_MS: u64 = 1_000;
/// Time for commitments.
pub const COMMIT_MS: u64 = 60_000;
/// Time for submissions.
pub const SUBMIT_MS: u64 = 120_000;
/// Largest update.
pub const MAX_UPDATE_BYTES: u64 = 200_000;
/// Largest proof.
pub const MAX_PROOF_BYTES: u64 = 100_000;
/// The initial policy, in several messages.
pub const POLICY: &[u8] = &{
    let mut bytes = [0; 200_000];
    let mut at = 0;
    while at < bytes.len() {
        bytes[at] = (at % 251) as u8;
        at += 1;
    }
    bytes
};

/// The log's key.
pub fn log_key() -> SigningKey {
    SigningKey::from_bytes(&[42; 32])
}

/// A network of one governor, without public samples.
pub fn genesis() -> Genesis {
    let spec = EvalSpec::micro();
    let initial = weights(0);
    Genesis {
        name: "test.example/zk0".into(),
        log_key: log_key().verifying_key().to_bytes(),
        nonce: [7; 32],
        rules: Rules {
            min_dataset_samples: 4,
            min_eval_samples: 4,
            min_improvement_bps: 100,
            commit_window_ms: COMMIT_MS,
            submit_window_ms: SUBMIT_MS,
            evaluation_frames: EVALUATION_FRAMES,
            max_update_bytes: MAX_UPDATE_BYTES,
            max_proof_bytes: MAX_PROOF_BYTES,
            credits: CreditRule {
                bps_per_credit: 100,
                max_per_contribution: 1000,
                dispute_window_ms: 1000,
            },
            governance: Governance {
                governors: vec![Governor {
                    key: SigningNode::new(GOVERNOR).id(),
                    name: "governor".into(),
                    weight: 1,
                }],
                voting_ms: VOTING_MS,
                ..Governance::none()
            },
            ..Rules::default()
        },
        program: verifying_key(Mode::Direct).to_vec(),
        mode: Mode::Direct,
        evaluation: spec.encode(),
        policy: blob_digest(POLICY),
        initial: digest(&initial),
    }
}

/// Founds this genesis.
pub fn founding(genesis: Genesis) -> Founding {
    Founding {
        name: genesis.name,
        nonce: genesis.nonce,
        rules: genesis.rules,
        program: genesis.program,
        mode: genesis.mode,
        evaluation: EvalSpec::decode(&genesis.evaluation).unwrap(),
        initial: weights(0),
        quantised: genesis.initial.quantised,
        public_samples: None,
    }
}

/// Writes the policy file.
pub fn write_policy(out: &mut dyn Write) -> io::Result<[u8; 32]> {
    out.write_all(POLICY)?;
    Ok(blob_digest(POLICY).0)
}

/// Founds a network in `dir`.
pub fn found(
    dir: &Path,
    genesis: Genesis,
    clock: Arc<ManualClock>,
    config: Config,
) -> Result<Aggregator, RequestError> {
    let ledger = founding(genesis.clone())
        .found(dir, log_key(), &*clock, 1 << 20, write_policy)
        .unwrap();
    assert_eq!(*ledger.state().genesis(), genesis);
    drop(ledger);
    let network = genesis.network_id();
    Aggregator::open(dir, Some(&network), log_key(), clock, config)
}
