//! Test vectors: the bytes of every hashed or signed structure, committed as data. After a change on purpose, write them anew with
//! `ZK0_WRITE_VECTORS=1 cargo test -p zk0-protocol --test protocol encodings::`.

use std::fs;
use std::path::PathBuf;
use zk0_protocol::entries::entry::{DeadlinesMoved, LostContribution, MomentsComputed};
use zk0_protocol::entries::program::Program;
use zk0_protocol::entries::proposal::{Action, Ballot};
use zk0_protocol::entries::signed::{
    Enrolment, Leaving, OperatorDecision, Proposal, SignableStatement, UploadRequest, Vote,
};
use zk0_protocol::pruning::Pruning;
use zk0_protocol::request_head::{Method, RequestHead};
use zk0_protocol::rules::network_rules::{Scaffold, Strategy};
use zk0_protocol::tlog::checkpoint::Parsed;
use zk0_protocol::tlog::cosigner::Cosigner;
use zk0_protocol::tlog::key_rotation::{LogKeyRotation, LogKeyTakeover};
use zk0_protocol::tlog::witness::AddCheckpoint;
use zk0_protocol::{Body, Checkpoint, Entry, Signed, State, TlogProof};
use zk0_testkit::network::log::MemoryLog;
use zk0_testkit::network::log_keys::*;
use zk0_testkit::network::*;

fn check(name: &str, bytes: &[u8]) {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("tests/vectors")
        .join(format!("{name}.hex"));
    if std::env::var_os("ZK0_WRITE_VECTORS").is_some() {
        fs::write(&path, hex::encode(bytes) + "\n").unwrap();
    }
    let vector = fs::read_to_string(&path).unwrap();
    assert_eq!(vector.trim_end(), hex::encode(bytes), "{name} has changed");
}

/// A state after an opening and a commitment.
fn chain() -> Chain {
    Chain::all_committed(1)
}

fn check_entry(name: &str, body: Body) {
    let entry = entry(T0, body);
    let bytes = entry.encode().unwrap();
    check(name, &bytes);
    assert_eq!(Entry::decode(&bytes).unwrap(), entry);
}

fn check_signed<T: SignableStatement + Clone>(name: &str, statement: T) {
    let signed = Signed::new(statement, &key(0));
    signed.verify().unwrap();
    check(name, &borsh::to_vec(&signed).unwrap());
}

#[test]
fn entries() {
    let state: State = chain().state;
    check_entry("entries/genesis", Body::Genesis(genesis()));
    check_entry("entries/node-enrolled", enrolled(0));
    check_entry("entries/dataset-committed", registered(state.network(), 0));
    check_entry(
        "entries/round-opened",
        Body::RoundOpened(opened(&state, T0)),
    );
    check_entry(
        "entries/update-committed",
        committed(&state, 0, weights(0x10)),
    );
    check_entry("entries/contribution-accepted", accepted(&state, 0));
    check_entry(
        "entries/contribution-rejected",
        rejected(&state, 0, invalid_proof()),
    );
    check_entry(
        "entries/round-closed",
        Body::RoundClosed(closed(&state, weights(0x50))),
    );
    check_entry(
        "entries/commitments-closed",
        Body::CommitmentsClosed(commitments_closed(&state)),
    );
    check_entry(
        "entries/moments-computed",
        Body::MomentsComputed(MomentsComputed {
            round: 3,
            moments: digest(0x30),
        }),
    );
    let lost = LostContribution {
        round: 3,
        node: id(0),
    };
    check_entry("entries/files-lost", Body::FilesLost(lost));
    check_entry(
        "entries/contribution-left-out",
        Body::ContributionLeftOut(lost),
    );
    check_entry(
        "entries/deadlines-moved",
        Body::DeadlinesMoved(DeadlinesMoved {
            round: 3,
            by_ms: 3_600_000,
        }),
    );
    let decision = OperatorDecision {
        network: *state.network(),
        operator: id(0),
        node: id(1),
        suspended: true,
        number: 258,
    };
    check_entry(
        "entries/operator-decided",
        Body::OperatorDecided(Signed::new(decision, &key(0))),
    );
    check_entry(
        "entries/log-key-rotated",
        log_rotated_to(&state, &later_key(1)),
    );
    check_entry(
        "entries/randomness-drawn",
        Body::RandomnessDrawn(drawn(&state)),
    );
}

#[test]
fn statements() {
    let state = chain().state;
    check_signed(
        "signed/enrolment",
        Enrolment {
            network: digest(1),
            operator: id(0),
            node: id(1),
            name: "node 1".into(),
        },
    );
    check_signed(
        "signed/dataset-registration",
        registration(state.network(), 0),
    );
    check_signed(
        "signed/update-commitment",
        commitment(&state, 0, weights(0x10)),
    );
    check_signed(
        "signed/submission",
        submission(claim(&state, 0), 0).statement,
    );
    check_signed(
        "signed/upload-request",
        UploadRequest {
            network: *state.network(),
            round: 0,
            node: id(0),
            blob: digest(0x10),
            size: 12345,
        },
    );
    check_signed(
        "signed/vote",
        Vote {
            network: *state.network(),
            proposal: 258,
            of: digest(0x10),
            voter: id(0),
            ballot: Ballot::Abstain,
        },
    );
    check_signed(
        "signed/leaving",
        Leaving {
            network: *state.network(),
            node: id(0),
            round: 1,
        },
    );
    check_signed(
        "signed/operator-decision",
        OperatorDecision {
            network: *state.network(),
            operator: id(0),
            node: id(1),
            suspended: true,
            number: 258,
        },
    );
    let rotation = LogKeyRotation {
        operator: id(0),
        ..log_rotation(&state, &later_key(1))
    };
    check_signed("signed/log-key-rotation", rotation.clone());
    let rotation = LogKeyRotation {
        with: id(0),
        ..rotation
    };
    check_signed("signed/log-key-takeover", LogKeyTakeover { rotation });
    check_signed(
        "signed/pruning",
        Pruning {
            network: digest(1),
            operator: id(0),
            entries: 57,
            updates_before: 8,
            proofs_before: 4,
            weights_before: 2,
        },
    );
    check_signed(
        "signed/request-head",
        RequestHead {
            network: *state.network(),
            run: [1; 16],
            method: Method::Record,
            round: Some(0),
            body: digest(0x20),
            sender: id(0),
            time_ms: T0,
            nonce: [2; 16],
        },
    );
}

/// A strategy that was added has the next number, so that ledgers keep their encoding.
#[test]
fn strategies() {
    let strategy = Strategy::Scaffold(Scaffold {
        steps: 600,
        learning_rate_millionths: 20_000,
        restart_rounds: 20,
    });
    check("strategy-scaffold", &borsh::to_vec(&strategy).unwrap());
}

#[test]
fn actions() {
    let program = Program::founding(&genesis().program);
    for (name, action) in [
        ("signed/replace-program", Action::ReplaceProgram(program)),
        (
            "signed/restore-weights",
            Action::RestoreWeights { round: 258 },
        ),
    ] {
        let proposal = Proposal {
            proposer: id(0),
            ..votes::proposal(&chain().state, 0, action)
        };
        check_signed(name, proposal);
    }
}

#[test]
fn digests() {
    let state = chain().state;
    check("network-id", &state.network().0);
    check("state-digest", &state.digest().0);
    let proposal = Proposal {
        proposer: id(0),
        ..votes::proposal(&state, 0, Action::RestoreWeights { round: 258 })
    };
    check("proposal-digest", &proposal.digest().0);
}

#[test]
fn checkpoints_and_receipts() {
    let genesis = genesis();
    let checkpoint = Checkpoint {
        size: 12,
        root: digest(0x33),
    };
    let text = checkpoint.sign(&genesis.name, &log_key()).unwrap();
    check("tlog/checkpoint", &text);
    assert_eq!(
        Checkpoint::open(&text, &genesis.name, &genesis.log_key),
        Ok(checkpoint)
    );
    let rotation = Signed::new(log_rotation(&Chain::new().state, &later_key(1)), &log_key());
    let text = checkpoint.sign_after(&genesis.name, &later_key(1), Some(&rotation));
    check("tlog/checkpoint-of-a-later-key", &text.unwrap());
    let receipt = MemoryLog::of_enrolments(2, 1).receipt(2);
    check("tlog/receipt", &borsh::to_vec(&receipt).unwrap());
    check("tlog/tlog-proof", &TlogProof::from(receipt).encode());
}

#[test]
fn keys_cosignatures_and_requests() {
    let checkpoint = Checkpoint {
        size: 12,
        root: digest(0x33),
    };
    let text = checkpoint.sign(&genesis().name, &log_key()).unwrap();
    let note = Parsed::read(&text).unwrap().note;
    let cosigner = Cosigner::new("witness.example/w", key(0)).unwrap();
    let log = genesis().verifier_key().unwrap();
    check("tlog/verifier-key-log", log.to_string().as_bytes());
    check(
        "tlog/verifier-key-witness",
        cosigner.key().to_string().as_bytes(),
    );
    check(
        "tlog/cosignature",
        &cosigner.cosign(note.text(), 1_700_000_000),
    );
    let request = AddCheckpoint {
        old: 7,
        proof: vec![digest(1), digest(2)],
        checkpoint: text,
    };
    check("tlog/add-checkpoint", &request.encode());
}

#[test]
fn a_signature_under_one_tag_is_not_valid_under_another() {
    // The same fields are under another tag. Only the tag keeps the two apart.
    #[derive(Clone, borsh::BorshSerialize, borsh::BorshDeserialize)]
    struct Other(UploadRequest);
    impl SignableStatement for Other {
        const TAG: &'static str = "zk0:another:v1";
        fn signer(&self) -> zk0_circuits::NodeId {
            self.0.node
        }
    }
    let request = UploadRequest {
        network: digest(0),
        round: 0,
        node: id(0),
        blob: digest(0x10),
        size: 12345,
    };
    let signature = Signed::new(Other(request.clone()), &key(0)).signature;
    let moved = Signed {
        statement: request,
        signature,
    };
    assert!(moved.verify().is_err());
}

/// A checkpoint is checked to the last byte: nothing can be added, removed or changed.
#[test]
fn a_checkpoint_has_one_form() {
    let genesis = genesis();
    let open = |text: &[u8]| Checkpoint::open(text, &genesis.name, &genesis.log_key);
    let checkpoint = Checkpoint {
        size: 12,
        root: digest(0x33),
    };
    let text = checkpoint.sign(&genesis.name, &log_key()).unwrap();
    for position in 0..text.len() {
        for bit in 0..8 {
            let mut changed = text.clone();
            changed[position] ^= 1 << bit;
            assert!(
                open(&changed).is_err(),
                "bit {bit} of byte {position} does not matter"
            );
        }
        assert!(open(&text[..position]).is_err());
    }
    assert!(open(&[&text[..], b"\n"].concat()).is_err());
    // The same valid signature line stands in the text twice.
    let line = text.split(|byte| *byte == b'\n').nth(4).unwrap();
    let doubled = [&text[..], line, b"\n"].concat();
    assert!(open(&doubled).is_err());
    // Another key signed the checkpoint, or it is for another log.
    let other = checkpoint.sign(&genesis.name, &key(0)).unwrap();
    assert!(open(&other).is_err());
    let other = checkpoint.sign("another.log", &log_key()).unwrap();
    assert!(open(&other).is_err());
    assert!(open(&vec![b'a'; 1 << 20]).is_err());
}
