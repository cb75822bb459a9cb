//! Codes of refusals: their numbers, their encoding, and the table of `docs/refusals.md`.

use zk0_circuits::{Digest, NodeId};
use zk0_protocol::entries::codec::EntryError;
use zk0_protocol::entries::entry::{DisputeResolved, ENTRY_VERSION};
use zk0_protocol::entries::member::Standing;
use zk0_protocol::entries::proposal::impossible::Impossible;
use zk0_protocol::entries::proposal::Outcome;
use zk0_protocol::entries::refusal::claim_field::ClaimField;
use zk0_protocol::entries::refusal::code::{RoundFile, RoundStatement, UnknownCode};
use zk0_protocol::{Body, Entry, RefusalCode};
use zk0_testkit::network::{rejected, Chain};

const N: u64 = 7;

/// One refusal of each code, in the order of the numbers. All digests are zero, and all numbers are 7.
fn examples() -> Vec<RefusalCode> {
    let (node, digest, round, limit) = (NodeId([0; 32]), Digest([0; 32]), N, N);
    use RefusalCode::*;
    vec![
        TooLarge {
            file: RoundFile::Proof,
            size: N,
            limit,
        },
        Signature,
        NotEnrolled(node),
        WrongNetwork {
            claimed: digest,
            ours: digest,
        },
        WrongRound {
            claimed: N,
            open: Some(N),
        },
        Late {
            what: RoundStatement::Claim,
            round,
            late_ms: N,
        },
        Duplicate {
            node,
            round,
            what: RoundStatement::Claim,
        },
        CopiedUpdate {
            update: digest,
            by: node,
        },
        NotCommitted(node),
        Binding(ClaimField::Challenge),
        Dataset,
        NoDataset(node),
        SmallDataset {
            samples: N,
            least: N,
        },
        NewDataset {
            root: digest,
            round,
        },
        ProofDigest {
            signed: digest,
            actual: digest,
        },
        MalformedProof,
        OtherClaim,
        OtherProgram,
        InvalidProof,
        UpdateDigest {
            expected: digest,
            actual: digest,
        },
        MalformedUpdate,
        OtherWeights {
            proven: digest,
            actual: digest,
        },
        MissingUpdate(digest),
        NotActive {
            node,
            standing: Standing::Suspended,
        },
        NotInvited { node, round },
        TooFar { bps: N, limit },
        RoundFull { round, limit },
        NoVerifier,
        EvalSamples {
            asked: 7,
            least: 7,
            most: N,
        },
        CommitmentsClosed { round },
        NoRandomness { round },
        Paused { node, until: N },
        UnreadWeights {
            tensor: 7,
            index: N,
            found: 7,
            expected: 7,
            bits: 7,
        },
        OtherWeightCheck { claimed: digest },
        OtherModels,
    ]
}

fn entry(body: Body) -> Entry {
    Entry {
        version: ENTRY_VERSION,
        time_ms: 1,
        body,
    }
}

/// A type that is `Copy` can hold no text, so no sentence and no word of a library gets onto a ledger.
#[test]
fn no_text_gets_onto_the_ledger() {
    fn holds_no_text<T: Copy>() {}
    holds_no_text::<RefusalCode>();
    holds_no_text::<Impossible>();
    holds_no_text::<Standing>();
}

#[test]
fn the_table_in_the_docs_has_every_code() {
    let mut table = String::from(
        "| number | code | explanation | on the ledger |\n| --- | --- | --- | --- |\n",
    );
    let zero = Digest([0; 32]).to_string();
    for (number, code) in (1..).zip(examples()) {
        assert_eq!(code.number(), number);
        let debug = format!("{code:?}");
        let name = debug.split([' ', '(']).next().unwrap_or_default();
        let explained = code.to_string().replace(&zero, "…").replace('7', "…");
        let recorded = match code.follows_from_ledger() || code.follows_from_blobs() {
            true => "yes",
            false => "no",
        };
        table += &format!("| {number} | `{name}` | {explained} | {recorded} |\n");
    }
    let page = include_str!("../../docs/refusals.md");
    assert!(
        page.contains(&table),
        "docs/refusals.md has to hold:\n{table}"
    );
}

/// The numbers are data of ledgers, and so are the encodings of the arguments.
#[test]
fn a_code_is_a_number_and_its_arguments() {
    let encoded = |code: RefusalCode| borsh::to_vec(&code).unwrap();
    assert_eq!(encoded(RefusalCode::InvalidProof), [19]);
    assert_eq!(
        encoded(RefusalCode::Binding(ClaimField::Challenge)),
        [10, 14]
    );
    let late = RefusalCode::Late {
        what: RoundStatement::Claim,
        round: 1,
        late_ms: 2,
    };
    let bytes = [
        &[6, 1][..],
        &[1, 0, 0, 0, 0, 0, 0, 0],
        &[2, 0, 0, 0, 0, 0, 0, 0],
    ]
    .concat();
    assert_eq!(encoded(late), bytes);
    for code in examples() {
        let resolved = DisputeResolved {
            dispute: 3,
            upheld: Some(code),
        };
        let entry = entry(Body::DisputeResolved(resolved));
        assert_eq!(Entry::decode(&entry.encode().unwrap()), Ok(entry));
    }
}

/// A newer release may have more codes. Its ledgers are not guessed at.
#[test]
fn an_unknown_code_is_an_error_with_its_number() {
    let chain = Chain::all_committed(1);
    let refused = rejected(&chain.state, 0, RefusalCode::InvalidProof);
    let resolved = Body::DisputeResolved(DisputeResolved {
        dispute: 3,
        upheld: Some(RefusalCode::InvalidProof),
    });
    for body in [refused, resolved] {
        for number in [0, 36, 255] {
            let mut bytes = entry(body.clone()).encode().unwrap();
            *bytes.last_mut().unwrap() = number;
            let error = Entry::decode(&bytes).unwrap_err();
            assert_eq!(error, EntryError::UnknownRefusal(UnknownCode(number)));
            assert!(
                error.to_string().contains(&format!("refusal {number} is")),
                "{error}"
            );
        }
    }
}

/// Each name that a claim's check gives is a field of its own.
#[test]
fn every_field_of_a_claim_has_a_number() {
    for field in 1..=19u8 {
        let field: ClaimField = borsh::from_slice(&[field]).unwrap();
        assert_eq!(ClaimField::named(&field.to_string()), Some(field));
    }
    assert!(borsh::from_slice::<ClaimField>(&[20]).is_err());
}

#[test]
fn an_outcome_is_a_number_and_its_arguments() {
    let outcome = Outcome::Impossible(Impossible::RoundForgotten(2));
    let bytes = [&[4, 13][..], &[2, 0, 0, 0, 0, 0, 0, 0]].concat();
    assert_eq!(borsh::to_vec(&outcome).unwrap(), bytes);
}
