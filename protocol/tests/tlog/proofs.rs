//! Receipts as tlog-proof bundles (C2SP tlog-proof).

use zk0_protocol::tlog::tlog_proof::ProofError;
use zk0_protocol::{TlogProof, WitnessPolicy};
use zk0_testkit::network::log::{log_vkey, MemoryLog};
use zk0_testkit::network::*;

fn proof(index: u64) -> TlogProof {
    MemoryLog::of_enrolments(5, 0).receipt(index).into()
}

#[test]
fn a_receipt_is_a_proof_that_stands_alone() {
    for index in 0..6 {
        let proof = proof(index);
        let text = proof.encode();
        let read = TlogProof::decode(&text).unwrap();
        assert_eq!(read, proof);
        let (witnessed, entry) = read.verify(&log_vkey(), &WitnessPolicy::none()).unwrap();
        assert_eq!(witnessed.checkpoint.size, 6);
        assert_eq!(Some(entry.encode().unwrap()), proof.extra);
        let head = "c2sp.org/tlog-proof@v1\nextra ";
        assert!(text.starts_with(head.as_bytes()));
    }
}

#[test]
fn a_proof_with_any_byte_changed_is_refused() {
    let good = proof(2).encode();
    for position in 0..good.len() {
        for bit in [0, 3, 7] {
            let mut changed = good.clone();
            changed[position] ^= 1 << bit;
            let accepted = TlogProof::decode(&changed)
                .and_then(|proof| proof.verify(&log_vkey(), &WitnessPolicy::none()))
                .is_ok();
            assert!(!accepted, "bit {bit} of byte {position} does not matter");
        }
        let cut = TlogProof::decode(&good[..position]);
        assert!(cut
            .and_then(|proof| proof.verify(&log_vkey(), &WitnessPolicy::none()))
            .is_err());
    }
}

#[test]
fn a_proof_of_something_else_is_refused() {
    let good = proof(2);
    let verify = |proof: &TlogProof| proof.verify(&log_vkey(), &WitnessPolicy::none());
    let mut other = good.clone();
    other.index = 3;
    assert!(matches!(
        verify(&other),
        Err(ProofError::NotIncluded { .. })
    ));
    for index in [6, u64::MAX] {
        other.index = index;
        assert!(verify(&other).is_err());
    }
    let mut longer = good.clone();
    longer.hashes.push(digest(0));
    assert!(verify(&longer).is_err());
    let mut without = good.clone();
    without.extra = None;
    assert_eq!(verify(&without), Err(ProofError::NoEntry));
    let read = TlogProof::decode(&without.encode()).unwrap();
    let leaf = good.extra.clone().unwrap();
    read.verify_leaf(&log_vkey(), &WitnessPolicy::none(), &leaf)
        .unwrap();
    assert!(read
        .verify_leaf(&log_vkey(), &WitnessPolicy::none(), b"another")
        .is_err());
    // The policy asks for a witness, and the proof has only the log's own signature.
    let secret = ed25519_dalek::SigningKey::from_bytes(&[200; 32]);
    let witness = zk0_protocol::tlog::cosigner::Cosigner::new("w.example", secret).unwrap();
    let policy = format!("witness W {}\nquorum W\n", witness.key());
    let policy = WitnessPolicy::parse(&policy).unwrap();
    assert!(matches!(
        good.verify(&log_vkey(), &policy),
        Err(ProofError::Checkpoint(_))
    ));
}

#[test]
fn what_is_no_proof_is_refused() {
    let good = String::from_utf8(proof(2).encode()).unwrap();
    let line = format!("{}\n", tlog_tiles::tlog::Hash([1; 32]));
    let index = good.find("index 2\n").unwrap();
    for bad in [
        String::new(),
        good.replacen("@v1", "@v2", 1),
        good.replacen("index 2", "index 02", 1),
        good.replacen("index 2", "index -2", 1),
        good.replacen("index 2\n", "", 1),
        good.replacen("extra ", "extra *", 1),
        format!(
            "{}index 2\n{}{}",
            &good[..index],
            line.repeat(64),
            &good[index + 8..]
        ),
        format!("{}index 2\nAAAA\n{}", &good[..index], &good[index + 8..]),
        "x".repeat(1 << 20),
    ] {
        assert!(TlogProof::decode(bad.as_bytes()).is_err(), "{bad:.60}");
    }
    assert!(TlogProof::decode(&[0xff; 100]).is_err());
}
