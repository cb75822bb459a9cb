//! Tiles and bundles, and the reader that verifies them. The tests compare with another implementation of RFC 6962, and use servers
//! that lie.

mod new_blobs;

use crate::network::log::{log_vkey, ORIGIN};
use crate::network::shelf::*;
use crate::network::votes::*;
use crate::network::*;
use ct_merkle::mem_backed_tree::MemoryBackedTree;
use ct_merkle::InclusionProof;
use proptest::prelude::*;
use sha2_11::Sha256;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use zk0_ledger::folder;
use zk0_ledger::log::Ledger;
use zk0_ledger::published::export::{export, ExportError};
use zk0_ledger::published::mirror::{mirror, MirrorError};
use zk0_ledger::published::publication::Publication;
use zk0_ledger::published::reader::{PublishedError, PublishedLog};
use zk0_ledger::published::source::FolderSource;
use zk0_ledger::{BlobError, Blobs};
use zk0_protocol::entries::proposal::{Action, Ballot, Outcome};
use zk0_protocol::tlog::checkpoint::Parsed;
use zk0_protocol::tlog::cosigner::Cosigner;
use zk0_protocol::tlog::layout::{tiles, Resource, Tile, TileKind};
use zk0_protocol::WitnessPolicy;

fn leaves(count: u64, seed: u8) -> Vec<Vec<u8>> {
    (0..count)
        .map(|index| vec![seed; 1 + (index as usize * 7) % 50])
        .zip(0u64..)
        .map(|(leaf, index)| [leaf, index.to_be_bytes().to_vec()].concat())
        .collect()
}

fn open<'a>(source: &'a ShownLog<'_>) -> Result<PublishedLog<'a>, PublishedError> {
    PublishedLog::open(source, &log_vkey(), &WitnessPolicy::none())
}

#[test]
fn paths_are_those_of_the_specification() {
    let tile = |kind, number, width| {
        Resource::Tile(Tile {
            kind,
            number,
            width,
        })
    };
    for (path, resource) in [
        ("checkpoint", Resource::Checkpoint),
        ("zk0/pruned", Resource::Pruned),
        ("tile/0/000", tile(TileKind::Hashes(0), 0, 256)),
        (
            "tile/3/x001/x234/067",
            tile(TileKind::Hashes(3), 1_234_067, 256),
        ),
        ("tile/0/x001/000.p/7", tile(TileKind::Hashes(0), 1000, 7)),
        ("tile/entries/999.p/255", tile(TileKind::Entries, 999, 255)),
        ("zk0/checkpoints/012", tile(TileKind::Checkpoints, 12, 256)),
        (
            "blobs/sha256/0303030303030303030303030303030303030303030303030303030303030303",
            Resource::Blob(digest(3)),
        ),
    ] {
        assert_eq!(Resource::parse(path), Some(resource), "{path}");
        assert_eq!(resource.to_string(), path);
    }
    for path in [
        "",
        "/checkpoint",
        "tile",
        "tile/0",
        "tile/0/0",
        "tile/0/00",
        "tile/0/0000",
        "tile/0/x000/000",
        "tile/0/001/000",
        "tile/0/x001/x000",
        "tile/00/000",
        "tile/8/000",
        "tile/63/000",
        "tile/256/000",
        "tile/0/000.p/0",
        "tile/0/000.p/01",
        "tile/0/000.p/256",
        "tile/0/000.p/-1",
        "tile/0/000.p/+1",
        "tile/0/000.p/1/2",
        "tile/0/+12",
        "tile/0/x018/x446/x744/x073/x709/x551/616",
        "tile/0/x999/x999/x999/x999/x999/x999/x999/999",
        "tile/entries/../000",
        "blobs/sha256/..",
        "blobs/sha256/AB03030303030303030303030303030303030303030303030303030303030303",
        "zk0/checkpoints/",
    ] {
        assert_eq!(Resource::parse(path), None, "{path}");
    }
}

/// The specification gives this example: a tree of 70,000 entries.
#[test]
fn a_tree_has_the_tiles_that_the_specification_says() {
    let count = |kind, full: bool| {
        let of = |tile: &Tile| tile.kind == kind && tile.is_full() == full;
        tiles(70_000)
            .filter(of)
            .map(|tile| tile.width)
            .collect::<Vec<_>>()
    };
    assert_eq!(count(TileKind::Hashes(0), true).len(), 273);
    assert_eq!(count(TileKind::Hashes(0), false), [112]);
    assert_eq!(count(TileKind::Hashes(1), true).len(), 1);
    assert_eq!(count(TileKind::Hashes(1), false), [17]);
    assert_eq!(count(TileKind::Hashes(2), true).len(), 0);
    assert_eq!(count(TileKind::Hashes(2), false), [1]);
    assert_eq!(count(TileKind::Hashes(3), false), [] as [u16; 0]);
    let of_256: Vec<_> = tiles(256).map(|tile| tile.to_string()).collect();
    let expected = [
        "tile/0/000",
        "tile/1/000.p/1",
        "tile/entries/000",
        "zk0/checkpoints/000",
    ];
    assert_eq!(of_256, expected);
    let beyond = Tile {
        kind: TileKind::Entries,
        number: u64::MAX,
        width: 256,
    };
    assert!(!beyond.is_in(u64::MAX));
}

#[test]
fn another_implementation_verifies_what_is_read_from_tiles() {
    let leaves = leaves(600, 1);
    let shelf = Shelf::of(&leaves);
    for size in [1, 2, 3, 255, 256, 257, 511, 512, 513, 600] {
        let shown = shelf.at(size);
        let log = open(&shown).unwrap();
        let mut theirs = MemoryBackedTree::<Sha256, Vec<u8>>::new();
        leaves[..size as usize]
            .iter()
            .cloned()
            .for_each(|leaf| theirs.push(leaf));
        assert_eq!(log.checkpoint().root.0[..], theirs.root().as_bytes()[..]);
        for index in [0, 1, 254, 255, 256, 300, 511, 512, 599]
            .into_iter()
            .chain([size - 1])
        {
            if index >= size {
                assert!(matches!(
                    log.prove(index),
                    Err(PublishedError::NoEntry { .. })
                ));
                continue;
            }
            let leaf = &leaves[index as usize];
            assert_eq!(&log.entry(index).unwrap(), leaf);
            let proof = log.prove(index).unwrap();
            proof
                .verify_leaf(&log_vkey(), &WitnessPolicy::none(), leaf)
                .unwrap();
            let bytes = proof.hashes.iter().flat_map(|hash| hash.0).collect();
            let proof = InclusionProof::<Sha256>::try_from_bytes(bytes).unwrap();
            theirs.root().verify_inclusion(leaf, index, &proof).unwrap();
        }
        for older in [1, 2, 255, 256, 257, 512, size]
            .into_iter()
            .filter(|older| *older <= size)
        {
            log.continues(&shelf.checkpoint(older)).unwrap();
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]

    /// Every hash of every tile is the root that the other implementation computes over the entries below it.
    #[test]
    fn tiles_hold_the_roots_of_their_subtrees(size in 1u64..300) {
        let leaves = leaves(size, 2);
        let shelf = Shelf::of(&leaves);
        for tile in tiles(size) {
            let TileKind::Hashes(level) = tile.kind else { continue };
            let bytes = zk0_ledger::published::tiles::read(&shelf.store, size, &tile).unwrap().unwrap();
            prop_assert_eq!(bytes.len(), usize::from(tile.width) * 32);
            let span = 256usize.pow(level.into());
            for (at, hash) in bytes.chunks(32).enumerate() {
                let first = (tile.start() as usize + at) * span;
                let mut theirs = MemoryBackedTree::<Sha256, Vec<u8>>::new();
                leaves[first..first + span].iter().cloned().for_each(|leaf| theirs.push(leaf));
                let root = theirs.root();
                prop_assert_eq!(hash, &root.as_bytes()[..]);
            }
        }
    }
}

#[test]
fn a_tile_never_changes_once_it_is_there() {
    let shelf = Shelf::of(&leaves(300, 3));
    for older in [1, 255, 256, 299] {
        for tile in tiles(older) {
            let read =
                |size| zk0_ledger::published::tiles::read(&shelf.store, size, &tile).unwrap();
            assert_eq!(read(older), read(300), "{tile}");
            assert!(read(older).is_some());
            assert_eq!(read(older - 1).is_some(), tile.is_in(older - 1), "{tile}");
        }
    }
}

#[test]
fn any_changed_byte_of_a_tile_or_bundle_is_noticed() {
    let shelf = Shelf::of(&leaves(260, 4));
    for tile in tiles(260).filter(|tile| tile.kind != TileKind::Checkpoints) {
        let bytes = zk0_ledger::published::tiles::read(&shelf.store, 260, &tile)
            .unwrap()
            .unwrap();
        let positions = (0..bytes.len()).step_by(131).chain([1, bytes.len() - 1]);
        for position in positions {
            let mut shown = shelf.at(260);
            let mut changed = bytes.clone();
            changed[position] ^= 1 << (position % 8);
            shown.instead.insert(tile.to_string(), Some(changed));
            let log = open(&shown).unwrap();
            let noticed = (0..2).any(|number| log.entries(number).is_err());
            assert!(noticed, "byte {position} of {tile} does not matter");
        }
        for instead in [
            Some(Vec::new()),
            Some(bytes[..bytes.len() - 1].to_vec()),
            None,
        ] {
            let mut shown = shelf.at(260);
            shown.instead.insert(tile.to_string(), instead);
            let log = open(&shown).unwrap();
            assert!((0..2).any(|number| log.entries(number).is_err()), "{tile}");
        }
        let mut shown = shelf.at(260);
        let endless = vec![0; 20 << 20];
        shown.instead.insert(tile.to_string(), Some(endless));
        let log = open(&shown).unwrap();
        assert!((0..2).any(|number| log.entries(number).is_err()), "{tile}");
    }
}

#[test]
fn where_a_partial_tile_is_gone_the_full_one_serves() {
    let shelf = Shelf::of(&leaves(512, 5));
    let old = shelf.at(300);
    let mut shown = shelf.at(512);
    // The checkpoint that the reader saw is of 300 entries. By now the log has 512 entries.
    let text = old.store.checkpoint(300).unwrap();
    shown.instead.insert("checkpoint".into(), text);
    for tile in [
        "tile/0/001.p/44",
        "tile/entries/001.p/44",
        "zk0/checkpoints/001.p/44",
    ] {
        shown.instead.insert(tile.into(), None);
    }
    let log = open(&shown).unwrap();
    assert_eq!(log.entries(1).unwrap().len(), 44);
    assert_eq!(log.checkpoints(1).unwrap().len(), 44);
    let proof = log.prove(299).unwrap();
    proof
        .verify_leaf(&log_vkey(), &WitnessPolicy::none(), &leaves(512, 5)[299])
        .unwrap();
}

#[test]
fn a_fork_and_a_log_that_is_behind_are_named() {
    let mut forked = leaves(300, 6);
    let honest = Shelf::of(&forked);
    forked[270] = b"another entry".to_vec();
    let forked = Shelf::of(&forked);
    let shown = forked.at(300);
    let log = open(&shown).unwrap();
    log.continues(&honest.checkpoint(270)).unwrap();
    for size in [271, 299, 300] {
        let known = honest.checkpoint(size);
        let error = log.continues(&known).unwrap_err();
        assert!(matches!(error, PublishedError::Forked { .. }), "{error}");
    }
    let shown = honest.at(200);
    let log = open(&shown).unwrap();
    let error = log.continues(&honest.checkpoint(201)).unwrap_err();
    assert!(
        matches!(
            error,
            PublishedError::Behind {
                published: 200,
                known: 201
            }
        ),
        "{error}"
    );
}

#[test]
fn a_checkpoint_that_cannot_be_is_refused_before_anything_is_read() {
    let shelf = Shelf::of(&leaves(3, 7));
    let root = shelf.checkpoint(3).root;
    for size in [0, (1 << 48) + 1, u64::MAX] {
        let text = zk0_protocol::Checkpoint { size, root }
            .sign(ORIGIN, &log_key())
            .unwrap();
        let mut shown = shelf.at(3);
        shown.instead.insert("checkpoint".into(), Some(text));
        assert!(
            matches!(open(&shown), Err(PublishedError::Size(_))),
            "{size}"
        );
    }
    // The tiles do not fit this size.
    for size in [2, 4, 257, 1 << 48] {
        let text = zk0_protocol::Checkpoint { size, root }
            .sign(ORIGIN, &log_key())
            .unwrap();
        let mut shown = shelf.at(3);
        shown.instead.insert("checkpoint".into(), Some(text));
        let log = open(&shown).unwrap();
        assert!(log.prove(0).is_err(), "{size}");
    }
    let mut shown = shelf.at(3);
    shown.instead.insert("checkpoint".into(), None);
    assert_eq!(open(&shown).err(), Some(PublishedError::NoCheckpoint));
    // A second operator signs with another key.
    let text = zk0_protocol::Checkpoint { size: 3, root }
        .sign(ORIGIN, &key(1))
        .unwrap();
    shown.instead.insert("checkpoint".into(), Some(text));
    assert!(matches!(open(&shown), Err(PublishedError::Checkpoint(_))));
}

#[test]
fn a_mirror_publishes_what_is_new_when_the_rules_have_dropped_the_witnesses() {
    let scratch = tempfile::tempdir().unwrap();
    let (dir, copy) = (scratch.path().join("ledger"), scratch.path().join("copy"));
    let cosigner = Cosigner::new("witness.example/w", key(1)).unwrap();
    let mut founding = genesis();
    founding.rules.witness_policy = format!(
        "witness W {} http://witness.example/w\nquorum W\n",
        cosigner.key()
    );
    let (mut ledger, _) = Ledger::create(&dir, founding, log_key(), T0).unwrap();
    let signed = ledger.checkpoint().to_vec();
    let note = Parsed::read(&signed).unwrap().note;
    let cosigned = [&signed[..], &cosigner.cosign(note.text(), T0 / 1000)].concat();
    folder::write_cosigned(&dir, &cosigned).unwrap();
    let mirrored = || {
        let source = Publication::open(&dir, None).unwrap();
        mirror(&source, &copy, None, None).unwrap();
        let copied = Publication::open(&copy, None).unwrap();
        copied.checkpoint().size
    };
    assert_eq!(mirrored(), 1);
    assert!(folder::policy(&copy).exists());
    let proposal = ledger.state().next_proposal();
    let action = Action::ChangeRules(Box::new(genesis().rules));
    let body = proposed(ledger.state(), 0, action);
    ledger.append(T0 + 1, body).unwrap();
    for voter in 0..3 {
        let body = voted(ledger.state(), voter, proposal, Ballot::For);
        ledger.append(T0 + 1, body).unwrap();
    }
    let body = settled(proposal, Outcome::Executed);
    ledger.append(T0 + 10 + VOTING + TIME_LOCK, body).unwrap();
    assert_eq!(mirrored(), ledger.size());
    assert!(!folder::policy(&copy).exists() && !folder::cosigned(&copy).exists());
    // A policy that the rules never named is the operator's own. It stays.
    let own = Cosigner::new("other.example/w", key(2)).unwrap();
    let own = format!("witness W {}\nquorum W\n", own.key());
    folder::write_policy(&copy, &WitnessPolicy::parse(&own).unwrap()).unwrap();
    folder::write_cosigned(&copy, &cosigned).unwrap();
    let source = Publication::open(&dir, None).unwrap();
    mirror(&source, &copy, None, None).unwrap();
    assert!(folder::policy(&copy).exists());
}

#[test]
fn a_damaged_blob_keeps_nothing_else_back_from_an_export_and_is_no_blob_of_a_mirror() {
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    let (dir, out) = (at("ledger"), at("export"));
    let committed = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/fixtures/ledger");
    rounds::copy(&committed, &dir);
    let view = Publication::open(&dir, None).unwrap();
    // A folder that is served as an export has nothing in it that is not public.
    let refused = export(&view, &dir).unwrap_err();
    assert!(matches!(refused, ExportError::IsLedger(_)), "{refused}");
    let blob = *view.public_blobs().next().unwrap();
    let file = Blobs::at(&dir).path(&blob);
    let right = fs::read(&file).unwrap();
    fs::write(&file, b"other bytes").unwrap();
    let done = export(&view, &out).unwrap();
    assert_eq!(done.blobs, view.public_blobs().count() as u64 - 1);
    assert_eq!(done.damaged.len(), 1);
    assert_eq!(Path::new(&done.damaged[0].place), file);
    let there = Blobs::at(&out).path(&blob);
    assert!(out.join("checkpoint").is_file() && !there.exists());
    // A killed export has left half of a blob.
    fs::write(&file, right).unwrap();
    let left = out.join("blobs/unfinished/left");
    fs::write(&left, b"half of a blob").unwrap();
    let done = export(&view, &out).unwrap();
    assert_eq!((done.blobs, done.damaged.len()), (1, 0));
    assert!(!left.exists());
    // Whoever serves other bytes under a blob's name is at fault.
    fs::write(&there, b"other bytes").unwrap();
    let refused = mirror(&FolderSource::at(&out), &at("mirror"), None, None).unwrap_err();
    let path = Resource::Blob(blob).to_string();
    assert!(refused.to_string().starts_with(&path), "{refused}");
    let MirrorError::WrongBlob { error, .. } = refused else {
        panic!("{refused}");
    };
    assert!(matches!(error, BlobError::WrongDigest { .. }), "{error}");
}

/// All files below a folder.
fn files(dir: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        let name = PathBuf::from(path.file_name().unwrap());
        match path.is_dir() {
            true => found.extend(
                files(&path)
                    .into_iter()
                    .map(|(below, bytes)| (name.join(below), bytes)),
            ),
            false => drop(found.insert(name, fs::read(&path).unwrap())),
        }
    }
    found
}

#[test]
fn the_committed_export_is_what_the_committed_ledger_publishes() {
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/fixtures");
    let view = Publication::open(&fixtures.join("ledger"), None).unwrap();
    let out = tempfile::tempdir().unwrap();
    export(&view, out.path()).unwrap();
    let (committed, now) = (files(&fixtures.join("export")), files(out.path()));
    assert!(committed == now, "{:?} {:?}", committed.keys(), now.keys());
}
