//! Verifier keys, policies and quorums (C2SP signed-note, tlog-policy, tlog-cosignature).

use ed25519_dalek::SigningKey;
use zk0_protocol::tlog::checkpoint::{CheckpointError, Parsed};
use zk0_protocol::tlog::cosigner::{self, Cosigner};
use zk0_protocol::tlog::verifier_key::{KeyError, Role};
use zk0_protocol::tlog::witness_policy::WitnessPolicyError;
use zk0_protocol::{Checkpoint, VerifierKey, WitnessPolicy};
use zk0_testkit::network::log::*;
use zk0_testkit::network::*;

fn cosigner(number: u8) -> Cosigner {
    let secret = SigningKey::from_bytes(&[200 + number; 32]);
    Cosigner::new(&format!("witness.example/w{number}"), secret).unwrap()
}

/// Parses a policy of `lines` that follow three witnesses A, B and C.
fn policy(lines: &str) -> Result<WitnessPolicy, WitnessPolicyError> {
    let witness = |name, number| format!("witness {name} {}\n", cosigner(number).key());
    let three = [witness("A", 0), witness("B", 1), witness("C", 2)].concat();
    WitnessPolicy::parse(&(three + lines))
}

#[test]
fn a_verifier_key_has_one_form() {
    // The specification C2SP signed-note gives this example.
    let example = "example.com/foo+530d903a+AekyeRrm56hApGFkyQR4ZCbV54Id2LKaANYcrnKv3U2k";
    let key: VerifierKey = example.parse().unwrap();
    assert_eq!((key.name(), key.role()), ("example.com/foo", Role::Log));
    assert_eq!(key.to_string(), example);
    let witness = cosigner(0).key().clone();
    assert_eq!(witness.to_string().parse(), Ok(witness.clone()));
    assert!(matches!(
        VerifierKey::of_role(Role::Log, &witness.to_string()),
        Err(KeyError::Type { found: 4, .. })
    ));
    // The same key has two ids in two roles.
    let log = VerifierKey::new(Role::Log, witness.name(), witness.public()).unwrap();
    assert_ne!(log.id(), witness.id());
    for position in 0..example.len() {
        let mut changed = example.as_bytes().to_vec();
        changed[position] ^= 1;
        let changed = String::from_utf8(changed).unwrap();
        assert!(changed.parse::<VerifierKey>().is_err(), "{changed}");
    }
    for text in [
        "",
        "a",
        "a+b",
        "a+530d903a+",
        "+530d903a+AQ==",
        "a b+530d903a+AekyeRrm",
    ] {
        assert!(text.parse::<VerifierKey>().is_err(), "{text}");
    }
    // All zeros encode a point of small order.
    assert!(matches!(
        VerifierKey::new(Role::Log, "log", &[0; 32]),
        Err(KeyError::Key(_))
    ));
}

#[test]
fn a_quorum_is_what_the_policy_says() {
    let cases: [(&str, &[u8]); 7] = [
        // The bits of each number stand for a set of cosigners. The list holds those of the eight sets that are enough.
        ("quorum none\n", &[0, 1, 2, 3, 4, 5, 6, 7]),
        ("quorum B\n", &[2, 3, 6, 7]),
        ("group g any A B C\nquorum g\n", &[1, 2, 3, 4, 5, 6, 7]),
        ("group g all A B C\nquorum g\n", &[7]),
        ("group g 2 A B C\nquorum g\n", &[3, 5, 6, 7]),
        ("group x any A B\ngroup y all x C\nquorum y\n", &[5, 6, 7]),
        (
            " # a comment\n\n\tgroup  g 1 A\t\nquorum g\n",
            &[1, 3, 5, 7],
        ),
    ];
    for (lines, enough) in cases {
        let policy = policy(lines).unwrap();
        for set in 0..8u8 {
            let cosigned = [set & 1 > 0, set & 2 > 0, set & 4 > 0];
            assert_eq!(
                policy.met_by(&cosigned),
                enough.contains(&set),
                "{lines}: {set}"
            );
        }
    }
}

#[test]
fn a_policy_that_says_something_else_is_refused() {
    let again = format!("witness D {}\nquorum none\n", cosigner(0).key());
    let same_key_other_name = {
        let secret = SigningKey::from_bytes(&[200; 32]);
        let key = Cosigner::new("witness.example/other", secret).unwrap();
        format!("witness D {}\nquorum none\n", key.key())
    };
    let as_log = format!("log {}\nquorum none\n", cosigner(3).key());
    for lines in [
        "",
        "quorum none\nquorum none\n",
        "quorum D\n",
        "quorum g\ngroup g any A\n",
        "group g 0 A B\nquorum g\n",
        "group g 3 A B\nquorum g\n",
        "group g -1 A B\nquorum g\n",
        "group g all\nquorum g\n",
        "group A any B\nquorum A\n",
        "group none any B\nquorum none\n",
        "group g any A\ngroup h any A B\nquorum h\n",
        "group g 2 A A\nquorum g\n",
        "quorum A B\n",
        "witnesses A\nquorum A\n",
        "quorum A\u{7}\n",
        &again,
        &same_key_other_name,
        &as_log,
    ] {
        assert!(policy(lines).is_err(), "{lines:?}");
    }
    assert!(WitnessPolicy::parse(&"#".repeat(100_000)).is_err());
    let deep: String = (0..100)
        .map(|n| format!("group g{} any g{n}\n", n + 1))
        .collect();
    assert!(policy(&format!("group g0 any A\n{deep}quorum g100\n")).is_err());
}

fn checkpoint() -> (Checkpoint, Vec<u8>) {
    let checkpoint = Checkpoint {
        size: 12,
        root: digest(0x33),
    };
    (checkpoint, checkpoint.sign(ORIGIN, &log_key()).unwrap())
}

/// Returns the note's text, which is everything before the signatures.
fn body(text: &[u8]) -> Vec<u8> {
    let at = text.windows(2).position(|pair| pair == b"\n\n").unwrap();
    text[..=at].to_vec()
}

#[test]
fn a_checkpoint_needs_its_quorum() {
    let policy = policy("group g 2 A B C\nquorum g\n").unwrap();
    let (checkpoint, text) = checkpoint();
    let note = |cosigners: &[u8]| {
        let lines = cosigners.iter().map(|number| {
            cosigner(*number).cosign(&body(&text), 1_700_000_000 + u64::from(*number))
        });
        [text.clone(), lines.flatten().collect()].concat()
    };
    let open = |note: &[u8]| policy.open(note, &log_vkey());
    let opened = open(&note(&[0, 2])).unwrap();
    assert_eq!(opened.checkpoint, checkpoint);
    let times = [
        ("A".to_owned(), 1_700_000_000),
        ("C".to_owned(), 1_700_000_002),
    ];
    assert_eq!(opened.cosigners, times);
    assert_eq!(open(&note(&[2, 1, 0])).unwrap().cosigners.len(), 3);
    // There are too few cosignatures, the same witness signs twice, or the witnesses are unknown.
    for few in [&[][..], &[1], &[1, 1], &[1, 9], &[7, 8, 9]] {
        let error = open(&note(few)).unwrap_err();
        assert!(
            matches!(error, CheckpointError::NoQuorum { .. }),
            "{few:?}: {error}"
        );
    }
    // Unknown signatures do no harm. An invalid signature under a known key is an error.
    open(&note(&[0, 9, 2])).unwrap();
    let other = cosigner(0).cosign(b"another text\n", 1_700_000_000);
    let spoilt = [note(&[1, 2]), other].concat();
    assert!(matches!(open(&spoilt), Err(CheckpointError::Signature(_))));
    // Cosignatures of witnesses cannot replace the log's signature.
    let by_another = checkpoint.sign(ORIGIN, &key(0)).unwrap();
    let lines = [0, 1, 2].map(|number| cosigner(number).cosign(&body(&text), 1));
    let unsigned = [by_another, lines.concat()].concat();
    assert!(matches!(
        open(&unsigned),
        Err(CheckpointError::Signature(_))
    ));
    // A cosignature is valid only for this text and this time.
    let good = note(&[0, 2]);
    for position in 0..good.len() {
        let mut changed = good.clone();
        changed[position] ^= 1;
        let opened = open(&changed);
        assert!(opened.is_err(), "byte {position} does not matter");
    }
    // A cosignature without a time is not valid.
    let timeless = [
        text.clone(),
        cosigner(0).cosign(&body(&text), 0),
        cosigner(1).cosign(&body(&text), 1),
    ]
    .concat();
    assert!(open(&timeless).is_err());
}

#[test]
fn a_log_key_is_no_witness_key_and_the_other_way_round() {
    // One secret has both roles. A signature of one role is not valid in the other.
    let (_, text) = checkpoint();
    let witness = Cosigner::new(ORIGIN, log_key()).unwrap();
    let policy = format!("witness W {}\nquorum W\n", witness.key());
    let policy = WitnessPolicy::parse(&policy).unwrap();
    assert!(policy.open(&text, &log_vkey()).is_err());
    let cosigned = [text.clone(), witness.cosign(&body(&text), 5)].concat();
    policy.open(&cosigned, &log_vkey()).unwrap();
}

#[test]
fn a_witness_answer_is_searched_for_one_valid_cosignature() {
    let (_, text) = checkpoint();
    let note = Parsed::read(&text).unwrap().note;
    let witness = cosigner(0);
    let good = witness.cosign(note.text(), 1_700_000_000);
    let of_another_text = witness.cosign(b"another text\n", 1_700_000_000);
    let of_another = cosigner(1).cosign(note.text(), 1_700_000_000);
    let find = |answer: &[u8]| cosigner::find(answer, witness.key(), &note);
    for answer in [
        &b""[..],
        b"\n\n",
        b"nonsense\n",
        &of_another_text,
        &of_another,
        &good[..good.len() - 1],
    ] {
        assert!(find(answer).is_none());
    }
    let all = [b"nonsense\n", &of_another[..], &of_another_text, &good].concat();
    assert_eq!(find(&all).unwrap().to_bytes(), good);
}
