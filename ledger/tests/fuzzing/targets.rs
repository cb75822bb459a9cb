//! What is given random inputs, and what it starts from.

use std::collections::BTreeMap;
use std::str::from_utf8;

use ed25519_dalek::SigningKey;
use zk0_ledger::cosignature::Cosigner;
use zk0_ledger::layout::{Kind, Resource, Tile};
use zk0_ledger::signed::{SignatureError, Submission, UploadRequest};
use zk0_ledger::witness::{AddCheckpoint, Witness};
use zk0_ledger::{
    bundle, tiles, Checkpoint, Entry, Policy, PublishedLog, Receipt, Signed, State, TlogProof,
    VerifierKey,
};

use crate::network::shelf::{log_vkey, Shelf, Shown, ORIGIN};
use crate::network::votes::{proposed, settled, voted};
use crate::network::{
    accepted, closed, committed, enrolled, entry, genesis, log_key, opened, registered, rejected,
    submission, weights, Chain, T0,
};
use zk0_ledger::governance::{Action, Ballot, Outcome};
use zk0_ledger::Body;

/// What any input may make a reader allocate: borsh makes room for a mebibyte of a string before it finds that there is less.
pub const SLACK: usize = (1 << 20) + (128 << 10);

/// A reader under test.
pub struct Target {
    pub seeds: Vec<Vec<u8>>,
    pub run: Box<dyn FnMut(&[u8]) -> Result<(), String>>,
}

pub const NAMES: [&str; 15] = [
    "entry",
    "checkpoint",
    "cosigned",
    "policy",
    "verifier_key",
    "tlog_proof",
    "add_checkpoint",
    "bundle",
    "path",
    "hash_tile",
    "entry_bundle",
    "receipt",
    "submission",
    "upload_request",
    "state",
];

pub fn target(name: &str) -> Target {
    match name {
        "entry" => Target {
            seeds: entries(),
            run: Box::new(|bytes| Entry::decode(bytes).map(drop).map_err(text)),
        },
        "checkpoint" => {
            let key = log_key().verifying_key().to_bytes();
            Target {
                seeds: vec![checkpoint()],
                run: Box::new(move |bytes| {
                    Checkpoint::open(bytes, ORIGIN, &key)
                        .map(drop)
                        .map_err(text)
                }),
            }
        }
        "cosigned" => {
            let policy = Policy::parse(&policy()).unwrap();
            let cosigned = [checkpoint(), cosigner().cosign(note_text(), 1)].concat();
            Target {
                seeds: vec![cosigned],
                run: Box::new(move |bytes| policy.open(bytes, &log_vkey()).map(drop).map_err(text)),
            }
        }
        "policy" => Target {
            seeds: vec![policy().into_bytes()],
            run: Box::new(|bytes| Policy::parse(utf8(bytes)?).map(drop).map_err(text)),
        },
        "verifier_key" => Target {
            seeds: vec![log_vkey().to_string().into_bytes()],
            run: Box::new(|bytes| utf8(bytes)?.parse::<VerifierKey>().map(drop).map_err(text)),
        },
        "tlog_proof" => Target {
            seeds: vec![proof()],
            run: Box::new(|bytes| {
                let proof = TlogProof::decode(bytes).map_err(text)?;
                let leaf = proof.extra.clone().unwrap_or_default();
                let verified = proof.verify_leaf(&log_vkey(), &Policy::none(), &leaf);
                verified.map(drop).map_err(text)
            }),
        },
        "add_checkpoint" => {
            let mut witness = Witness::new(cosigner());
            let shelf = Shelf::of(&leaves());
            witness
                .watch(log_vkey(), Some(shelf.checkpoint(3)))
                .unwrap();
            Target {
                seeds: vec![add_checkpoint(&shelf)],
                run: Box::new(move |bytes| witness.check(bytes, 1).map(drop).map_err(text)),
            }
        }
        "bundle" => Target {
            seeds: vec![[vec![2], framed(&[b"one".to_vec(), vec![]])].concat()],
            run: Box::new(|bytes| {
                let (width, bundle) = bytes.split_first().ok_or("no bytes at all")?;
                bundle::split(bundle, u16::from(*width))
                    .map(drop)
                    .map_err(text)
            }),
        },
        "path" => Target {
            seeds: [
                "checkpoint",
                "tile/3/x001/x234/067",
                "tile/entries/999.p/255",
            ]
            .map(|path| path.as_bytes().to_vec())
            .into(),
            run: Box::new(|bytes| match Resource::parse(utf8(bytes)?) {
                Some(Resource::Tile(tile)) if tile.width == 1 => Err("a tile of one".into()),
                Some(_) => Ok(()),
                None => Err("no path".into()),
            }),
        },
        "hash_tile" => served(Kind::Hashes(0)),
        "entry_bundle" => served(Kind::Entries),
        "receipt" => Target {
            seeds: vec![receipt()],
            run: Box::new(|bytes| {
                let receipt: Receipt = borsh::from_slice(bytes).map_err(text)?;
                let key = genesis().log_key;
                receipt.verify(&key, ORIGIN).map(drop).map_err(text)
            }),
        },
        "submission" => Target {
            seeds: vec![borsh::to_vec(&signed_submission()).unwrap()],
            run: Box::new(|bytes| {
                let signed: Signed<Submission> = borsh::from_slice(bytes).map_err(text)?;
                signed.verify().map(drop).map_err(without_names)
            }),
        },
        "upload_request" => Target {
            seeds: vec![borsh::to_vec(&upload_request()).unwrap()],
            run: Box::new(|bytes| {
                let signed: Signed<UploadRequest> = borsh::from_slice(bytes).map_err(text)?;
                signed.verify().map(drop).map_err(without_names)
            }),
        },
        "state" => Target {
            seeds: vec![borsh::to_vec(&history().0).unwrap()],
            run: Box::new(|bytes| borsh::from_slice::<State>(bytes).map(drop).map_err(text)),
        },
        other => panic!("no target {other}; there are {NAMES:?}"),
    }
}

fn text(error: impl ToString) -> String {
    error.to_string()
}

/// Whoever's signature it is not: one outcome.
fn without_names(error: SignatureError) -> String {
    match error {
        SignatureError::BadKey(_) => "no key".into(),
        SignatureError::Mismatch(..) => "no signature".into(),
    }
}

fn utf8(bytes: &[u8]) -> Result<&str, String> {
    from_utf8(bytes).map_err(text)
}

/// A state with something in each of its parts, and the entries that lead to it.
fn history() -> (State, Vec<Entry>) {
    let mut chain = Chain::new();
    let mut entries = vec![entry(T0, Body::Genesis(genesis()))];
    let network = *chain.state.network();
    let mut step = |chain: &mut Chain, body: Body| {
        entries.push(entry(chain.time_ms + 1, body.clone()));
        chain.apply(body);
    };
    for node in 0..3 {
        step(&mut chain, enrolled(node));
        step(&mut chain, registered(&network, node));
    }
    for round in 0..2 {
        let opening = Body::RoundOpened(opened(&chain.state, chain.time_ms + 1));
        step(&mut chain, opening);
        for node in 0..3 {
            let body = committed(&chain.state, node, weights(0x10 + 4 * round + node));
            step(&mut chain, body);
        }
        if round == 1 {
            break;
        }
        let body = accepted(&chain.state, 0);
        step(&mut chain, body);
        for node in 1..3 {
            let body = rejected(&chain.state, node, crate::network::invalid_proof());
            step(&mut chain, body);
        }
        let body = Body::RoundClosed(closed(&chain.state, weights(0x50)));
        step(&mut chain, body);
    }
    let body = proposed(&chain.state, 0, Action::Suspend(crate::network::id(2)));
    step(&mut chain, body);
    let body = voted(&chain.state, 1, 0, Ballot::Against);
    step(&mut chain, body);
    (chain.state, entries)
}

fn entries() -> Vec<Vec<u8>> {
    let (_, mut entries) = history();
    entries.push(entry(T0, settled(0, Outcome::Executed)));
    entries
        .iter()
        .map(|entry| entry.encode().unwrap())
        .collect()
}

fn leaves() -> Vec<Vec<u8>> {
    entries().into_iter().take(7).collect()
}

fn checkpoint() -> Vec<u8> {
    let root = crate::network::digest(5);
    let checkpoint = Checkpoint { size: 7, root };
    checkpoint.sign(ORIGIN, &log_key()).unwrap()
}

/// What a checkpoint's signatures sign.
fn note_text() -> &'static [u8] {
    let text = String::from_utf8(checkpoint()).unwrap();
    let (text, _) = text.split_once("\n\n").unwrap();
    Box::leak(format!("{text}\n").into_boxed_str()).as_bytes()
}

fn cosigner() -> Cosigner {
    Cosigner::new("witness.example/w", SigningKey::from_bytes(&[200; 32])).unwrap()
}

fn policy() -> String {
    let (log, witness) = (log_vkey(), cosigner().key().clone());
    format!(
        "log {log}\nwitness W {witness} https://witness.example/w\ngroup one any W\nquorum one\n"
    )
}

fn proof() -> Vec<u8> {
    let shelf = Shelf::of(&leaves());
    let shown = shelf.at(7);
    let log = PublishedLog::open(&shown, &log_vkey(), &Policy::none()).unwrap();
    log.prove(4).unwrap().encode()
}

fn receipt() -> Vec<u8> {
    let shelf = Shelf::of(&leaves());
    let proof = tlog_tiles::tlog::prove_record(7, 4, &shelf.store).unwrap();
    let receipt = Receipt {
        index: 4,
        entry: leaves()[4].clone(),
        checkpoint: shelf.store.checkpoint(7).unwrap().unwrap(),
        proof: proof
            .into_iter()
            .map(|hash| zk0_circuits::Digest(hash.0))
            .collect(),
    };
    borsh::to_vec(&receipt).unwrap()
}

fn add_checkpoint(shelf: &Shelf) -> Vec<u8> {
    let proof = tlog_tiles::tlog::prove_tree(7, 3, &shelf.store).unwrap();
    let request = AddCheckpoint {
        old: 3,
        proof: proof
            .into_iter()
            .map(|hash| zk0_circuits::Digest(hash.0))
            .collect(),
        checkpoint: shelf.checkpoint(7).sign(ORIGIN, &log_key()).unwrap(),
    };
    request.encode()
}

fn signed_submission() -> Signed<Submission> {
    let (state, _) = history();
    submission(crate::network::claim(&state, 1), 1)
}

fn upload_request() -> Signed<UploadRequest> {
    let request = UploadRequest {
        network: crate::network::digest(1),
        round: 2,
        node: crate::network::id(1),
        blob: crate::network::digest(2),
        size: 3,
    };
    Signed::new(request, &crate::network::key(1))
}

fn framed(items: &[Vec<u8>]) -> Vec<u8> {
    let mut framed = Vec::new();
    for item in items {
        bundle::push(&mut framed, item).unwrap();
    }
    framed
}

/// A log of seven entries whose server answers with the input in one place.
fn served(kind: Kind) -> Target {
    let shelf = Shelf::of(&leaves());
    let tile = Tile::at(kind, 0, 7).unwrap();
    let good = tiles::read(&shelf.store, 7, &tile).unwrap().unwrap();
    Target {
        seeds: vec![good],
        run: Box::new(move |bytes| {
            let shown = Shown {
                store: &shelf.store,
                size: 7,
                instead: BTreeMap::from([(tile.to_string(), Some(bytes.to_vec()))]),
            };
            let log = PublishedLog::open(&shown, &log_vkey(), &Policy::none()).map_err(text)?;
            log.entries(0).map(drop).map_err(text)?;
            log.prove(6).map(drop).map_err(text)
        }),
    }
}
