//! Input that is too large, of an unknown version, or not text is refused by name.

use zk0_protocol::entries::codec::EntryError;
use zk0_protocol::entries::entry::ENTRY_VERSION;
use zk0_protocol::rules::network_rules::Participation;
use zk0_protocol::{Checkpoint, Entry, VerifierKey, WitnessPolicy};
use zk0_testkit::network::*;

#[test]
fn unknown_versions_kinds_and_bytes_that_are_no_text_are_each_named() {
    let good = entry(T0, enrolled(1)).encode().unwrap();
    assert!(Entry::decode(&good).is_ok());
    let with = |at: usize, byte: u8| {
        let mut bytes = good.clone();
        bytes[at] = byte;
        Entry::decode(&bytes).unwrap_err()
    };
    let next = ENTRY_VERSION + 1;
    assert_eq!(with(0, next as u8), EntryError::UnknownVersion(next));
    assert_eq!(with(1, 1), EntryError::UnknownVersion(256 + ENTRY_VERSION));
    let malformed = |error: EntryError, words: &str| match error {
        EntryError::Malformed(text) => assert!(text.contains(words), "{text}"),
        other => panic!("{other:?}"),
    };
    // The kind follows the version and the time. The name ends the entry.
    for kind in [100, 255] {
        malformed(with(10, kind), &kind.to_string());
    }
    for byte in [0xff, 0xc0, 0x80] {
        malformed(with(good.len() - 1, byte), "utf-8");
    }
    malformed(Entry::decode(b"").unwrap_err(), "");
    malformed(Entry::decode(&good[..good.len() - 1]).unwrap_err(), "");
    malformed(
        Entry::decode(&[&good[..], b"\0"].concat()).unwrap_err(),
        "Not all bytes read",
    );
}

#[test]
fn what_strangers_call_themselves_is_quoted_short_and_does_nothing_to_a_terminal() {
    let name = &genesis().name;
    let checkpoint = Checkpoint {
        size: 1,
        root: zk0_circuits::Digest([1; 32]),
    };
    let signed = String::from_utf8(checkpoint.sign(name, &log_key()).unwrap()).unwrap();
    // A note holds no ASCII control characters. This control character, which is not ASCII, clears a screen as well.
    let hostile = format!("\u{9b}2Jlog'{}", "x".repeat(500));
    let other = signed.replacen(name.as_str(), &hostile, 1);
    let key = log_key().verifying_key().to_bytes();
    let refusals = [
        Checkpoint::open(other.as_bytes(), name, &key)
            .unwrap_err()
            .to_string(),
        hostile.parse::<VerifierKey>().unwrap_err().to_string(),
        WitnessPolicy::parse(&hostile).unwrap_err().to_string(),
        serde_json::from_value::<Participation>(serde_json::json!({ "listed": [hostile] }))
            .unwrap_err()
            .to_string(),
    ];
    for refusal in refusals {
        assert!(refusal.contains(r"\u{9b}2Jlog\'xxx"), "{refusal}");
        assert!(!refusal.contains(char::is_control), "{refusal}");
        assert!(refusal.len() < 500, "{refusal}");
    }
}
