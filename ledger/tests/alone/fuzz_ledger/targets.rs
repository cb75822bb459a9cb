//! The readers that get random inputs, and the valid inputs that fuzzing starts from.

use std::collections::BTreeMap;
use std::fs;
use std::str::from_utf8;
use std::time::Duration;

use ed25519_dalek::SigningKey;
use sha2::{Digest as _, Sha256};
use zk0_ledger::published::reader::{first_entry, PublishedLog};
use zk0_ledger::published::tiles;
use zk0_ledger::replay::{replay_with, ReplayOptions, SaveOptions, SavedError, SavedReplay};
use zk0_protocol::entries::signed::{SignatureError, Submission, UploadRequest};
use zk0_protocol::tlog::bundle;
use zk0_protocol::tlog::checkpoint::Parsed;
use zk0_protocol::tlog::cosigner::{self, Cosigner};
use zk0_protocol::tlog::layout::{Resource, Tile, TileKind};
use zk0_protocol::tlog::witness::{AddCheckpoint, Witness};
use zk0_protocol::{
    Checkpoint, Entry, Receipt, Rules, Signed, State, TlogProof, VerifierKey, WitnessPolicy,
};

use zk0_testkit::fuzzing::{Target, Targets};
use zk0_testkit::ledgers::rounds::ledger_with_a_round;
use zk0_testkit::ledgers::shelf::{Shelf, ShownLog};
use zk0_testkit::network::log::{log_vkey, ORIGIN};
use zk0_testkit::network::{claim, digest, genesis, id, key, log_key, submission};

use super::history::{applied, history, without_parts};

pub const TARGETS: Targets = Targets {
    names: &NAMES,
    target,
    // borsh makes room for a mebibyte of a string before it finds that there is less.
    slack: (1 << 20) + (128 << 10),
};

const NAMES: [&str; 22] = [
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
    "applied",
    "rules",
    "rules_json",
    "saved",
    "cosignature",
    "checkpoint_bundle",
    "first_entry",
];

fn target(name: &str) -> Target {
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
            let policy = WitnessPolicy::parse(&policy()).unwrap();
            let cosigned = [checkpoint(), cosigner().cosign(note_text(), 1)].concat();
            Target {
                seeds: vec![cosigned],
                run: Box::new(move |bytes| policy.open(bytes, &log_vkey()).map(drop).map_err(text)),
            }
        }
        "policy" => Target {
            seeds: vec![policy().into_bytes()],
            run: Box::new(|bytes| WitnessPolicy::parse(utf8(bytes)?).map(drop).map_err(text)),
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
                let verified = proof.verify_leaf(&log_vkey(), &WitnessPolicy::none(), &leaf);
                verified.map(drop).map_err(text)
            }),
        },
        "add_checkpoint" => {
            let mut witness = Witness::new(cosigner());
            let shelf = Shelf::of(&leaves());
            witness
                .watch(log_vkey(), Some(shelf.checkpoint(3)), 0)
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
        "hash_tile" => served(TileKind::Hashes(0)),
        "entry_bundle" => served(TileKind::Entries),
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
        "applied" => applied(),
        "rules" => Target {
            seeds: vec![borsh::to_vec(&genesis().rules).unwrap()],
            run: Box::new(|bytes| borsh::from_slice::<Rules>(bytes).map_err(text)?.check()),
        },
        "rules_json" => Target {
            seeds: vec![serde_json::to_vec_pretty(&genesis().rules).unwrap()],
            run: Box::new(|bytes| {
                serde_json::from_slice::<Rules>(bytes)
                    .map_err(text)?
                    .check()
            }),
        },
        "saved" => saved(),
        "cosignature" => cosigned_answer(),
        "checkpoint_bundle" => checkpoint_bundle(),
        "first_entry" => unverified(),
        other => panic!("no target {other}; there are {NAMES:?}"),
    }
}

pub fn text(error: impl ToString) -> String {
    error.to_string()
}

/// Returns one outcome for all wrong signatures, whoever the signer is.
fn without_names(error: SignatureError) -> String {
    match error {
        SignatureError::BadKey(_) => "no key".into(),
        SignatureError::Mismatch(..) => "no signature".into(),
    }
}

fn utf8(bytes: &[u8]) -> Result<&str, String> {
    from_utf8(bytes).map_err(text)
}

/// Reads an auditor's memory. If the input does not begin like a memory, it is the part that follows a correct digest.
fn saved() -> Target {
    let dir = tempfile::tempdir().unwrap();
    let (ledger, path) = (dir.path().join("ledger"), dir.path().join("saved"));
    drop(ledger_with_a_round(&ledger));
    let options = ReplayOptions {
        keep: Some(SaveOptions {
            path: path.clone(),
            every: Duration::ZERO,
        }),
        ..ReplayOptions::default()
    };
    replay_with(&ledger, options, &mut ());
    let whole = fs::read(&path).unwrap();
    let start = whole.iter().position(|byte| *byte == b'\n').unwrap() + 1;
    let format = whole[..start].to_vec();
    Target {
        seeds: vec![whole.clone(), whole[start + 32..].to_vec()],
        run: Box::new(move |bytes| {
            let _ = &dir;
            let file = match bytes.starts_with(&format) {
                true => bytes.to_vec(),
                false => [&format, &Sha256::digest(bytes)[..], bytes].concat(),
            };
            fs::write(&path, file).unwrap();
            match SavedReplay::read(&path) {
                Ok(saved) => saved.map(drop).ok_or("not there".into()),
                Err(SavedError::Unusable { why, .. }) => Err(why),
                Err(error) => panic!("{error}"),
            }
        }),
    }
}

/// Reads what a witness answers.
fn cosigned_answer() -> Target {
    let note = Parsed::read(&checkpoint()).unwrap().note;
    let cosigner = cosigner();
    let good = cosigner.cosign(note_text(), 1);
    let other = Cosigner::new("other.example/w", SigningKey::from_bytes(&[201; 32])).unwrap();
    let both = [other.cosign(note_text(), 1), good.clone()].concat();
    Target {
        seeds: vec![good, both],
        run: Box::new(
            move |bytes| match cosigner::find(bytes, cosigner.key(), &note) {
                Some(_) => Ok(()),
                None => Err(why_none(bytes, cosigner.key())),
            },
        ),
    }
}

/// States how far the best line of the answer gets, because `find` does not state why it ignores a line.
fn why_none(answer: &[u8], key: &VerifierKey) -> String {
    let lines = answer.split_inclusive(|byte| *byte == b'\n');
    let lines: Vec<&[u8]> = lines.filter_map(|line| line.strip_suffix(b"\n")).collect();
    let parsed = lines
        .iter()
        .filter_map(|line| signed_note::Signature::from_bytes(line).ok());
    let parsed: Vec<_> = parsed.collect();
    let own = parsed
        .iter()
        .find(|signature| signature.name() == key.name() && signature.id() == key.id());
    match (lines.is_empty(), parsed.is_empty(), own) {
        (true, ..) => "no line".into(),
        (_, true, _) => "no signature line".into(),
        (_, _, None) => "signatures of others".into(),
        (_, _, Some(own)) if own.signature().len() != 72 => "no cosignature".into(),
        (_, _, Some(_)) => "not valid".into(),
    }
}

/// Reads the log's checkpoints after each entry as a mirror does.
fn checkpoint_bundle() -> Target {
    let shelf = Shelf::of(&leaves());
    let tile = Tile::at(TileKind::Checkpoints, 0, 7).unwrap();
    let good = tiles::read(&shelf.store, 7, &tile).unwrap().unwrap();
    let key = log_key().verifying_key().to_bytes();
    Target {
        seeds: vec![good],
        run: Box::new(move |bytes| {
            let shown = ShownLog {
                store: &shelf.store,
                size: 7,
                instead: BTreeMap::from([(tile.to_string(), Some(bytes.to_vec()))]),
            };
            let log =
                PublishedLog::open(&shown, &log_vkey(), &WitnessPolicy::none()).map_err(text)?;
            for (after, checkpoint) in (1..).zip(log.checkpoints(0).map_err(text)?) {
                let checkpoint = checkpoint.ok_or("a checkpoint is missing")?;
                let opened = Checkpoint::open(&checkpoint, ORIGIN, &key).map_err(text)?;
                if opened != shelf.checkpoint(after) {
                    return Err("the checkpoint of another size".into());
                }
            }
            Ok(())
        }),
    }
}

/// Reads what a client reads before anything is verified. If the first byte is 0, this is the checkpoint. Otherwise it is the first
/// entry.
fn unverified() -> Target {
    let shelf = Shelf::of(&leaves());
    let tile = Tile::at(TileKind::Entries, 0, 7).unwrap();
    let entries = tiles::read(&shelf.store, 7, &tile).unwrap().unwrap();
    let checkpoint = shelf.store.checkpoint(7).unwrap().unwrap();
    Target {
        seeds: vec![[vec![0], checkpoint].concat(), [vec![1], entries].concat()],
        run: Box::new(move |bytes| {
            let (which, bytes) = bytes.split_first().ok_or("no bytes at all")?;
            let path = match which {
                0 => Resource::Checkpoint.to_string(),
                _ => tile.to_string(),
            };
            let shown = ShownLog {
                store: &shelf.store,
                size: 7,
                instead: BTreeMap::from([(path, Some(bytes.to_vec()))]),
            };
            let first = first_entry(&shown).map_err(text)?;
            State::found(&Entry::decode(&first).map_err(text)?)
                .map(drop)
                .map_err(|error| without_parts(text(error)))
        }),
    }
}

fn entries() -> Vec<Vec<u8>> {
    let (_, entries) = history();
    entries
        .iter()
        .map(|entry| entry.encode().unwrap())
        .collect()
}

fn leaves() -> Vec<Vec<u8>> {
    entries().into_iter().take(7).collect()
}

fn checkpoint() -> Vec<u8> {
    let root = digest(5);
    let checkpoint = Checkpoint { size: 7, root };
    checkpoint.sign(ORIGIN, &log_key()).unwrap()
}

/// Returns the text that a checkpoint's signatures sign.
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
    let log = PublishedLog::open(&shown, &log_vkey(), &WitnessPolicy::none()).unwrap();
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
    submission(claim(&state, 1), 1)
}

fn upload_request() -> Signed<UploadRequest> {
    let request = UploadRequest {
        network: digest(1),
        round: 2,
        node: id(1),
        blob: digest(2),
        size: 3,
    };
    Signed::new(request, &key(1))
}

fn framed(items: &[Vec<u8>]) -> Vec<u8> {
    let mut framed = Vec::new();
    for item in items {
        bundle::push(&mut framed, item).unwrap();
    }
    framed
}

/// A log of seven entries whose server answers with the input in one place.
fn served(kind: TileKind) -> Target {
    let shelf = Shelf::of(&leaves());
    let tile = Tile::at(kind, 0, 7).unwrap();
    let good = tiles::read(&shelf.store, 7, &tile).unwrap().unwrap();
    Target {
        seeds: vec![good],
        run: Box::new(move |bytes| {
            let shown = ShownLog {
                store: &shelf.store,
                size: 7,
                instead: BTreeMap::from([(tile.to_string(), Some(bytes.to_vec()))]),
            };
            let log =
                PublishedLog::open(&shown, &log_vkey(), &WitnessPolicy::none()).map_err(text)?;
            log.entries(0).map(drop).map_err(text)?;
            log.prove(6).map(drop).map_err(text)
        }),
    }
}
