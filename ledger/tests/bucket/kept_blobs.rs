//! Blobs that are kept in a bucket, and in a folder by its address: the ledger's folder is a cache of them.

use crate::bucket::cache::{emptied, held};
use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io::Read;
use std::path::Path;
use std::sync::{mpsc, Barrier};
use std::thread;
use std::time::{Duration, SystemTime};
use zk0_circuits::Digest;
use zk0_ledger::blobs::usage::StoreOperation;
use zk0_ledger::blobs::{BlobError, Blobs};
use zk0_ledger::bucket::waiting::RetryPeriod;
use zk0_ledger::bucket::Bucket;
use zk0_ledger::bucket::PART_BYTES;
use zk0_testkit::s3::S3;

const LIMIT: u64 = 1 << 30;

fn in_store(dir: &Path, address: &str, variables: &[(String, String)]) -> Blobs {
    let patience = RetryPeriod(Duration::from_secs(120));
    let bucket = Bucket::open(address, variables, patience).unwrap();
    Blobs::in_store(dir, Box::new(bucket)).unwrap()
}

/// Runs a test with a bucket of S3 and one of Google Cloud Storage, if there is a server, and with a folder.
fn with_stores(test: impl Fn(&dyn Fn(&Path) -> Blobs, &Path)) {
    for bucket in [S3::start(), S3::start_as_google()].into_iter().flatten() {
        let (address, variables) = (bucket.address("a/net"), bucket.variables());
        test(
            &|dir| in_store(dir, &address, &variables),
            &bucket.folder("a/net"),
        );
    }
    let folder = tempfile::tempdir().unwrap();
    let address = format!("file://{}", folder.path().join("a/net").display());
    let inside = folder.path().join("a/net/blobs/sha256");
    test(&|dir| in_store(dir, &address, &[]), &inside);
}

/// A reader of the same store, with another folder.
fn reader(dir: &Path, address: &str, variables: &[(String, String)]) -> Blobs {
    let patience = RetryPeriod(Duration::from_secs(120));
    let bucket = Bucket::open(address, variables, patience).unwrap();
    Blobs::beside_writer(dir, Box::new(bucket)).unwrap()
}

#[test]
fn blobs_of_all_sizes_come_back_when_the_folder_is_lost() {
    with_stores(|open, inside| {
        let dir = tempfile::tempdir().unwrap();
        let blobs = open(dir.path());
        let sizes = [
            0,
            1,
            PART_BYTES - 1,
            PART_BYTES,
            PART_BYTES + 1,
            2 * PART_BYTES + 5,
        ];
        let contents: Vec<Vec<u8>> = sizes
            .iter()
            .map(|size| (0..*size).map(|at| (at % 253) as u8).collect())
            .collect();
        let names: Vec<_> = contents
            .iter()
            .map(|bytes| blobs.put(bytes).unwrap())
            .collect();
        for (name, bytes) in names.iter().zip(&contents) {
            assert!(fs::read(inside.join(name.to_string())).unwrap() == *bytes);
        }
        // Another process, too, finds them.
        for blobs in [blobs, open(dir.path())] {
            emptied(dir.path());
            for (name, bytes) in names.iter().zip(&contents) {
                assert!(blobs.contains(name) && !blobs.is_here(name));
                assert!(blobs.get(name, LIMIT).unwrap() == *bytes);
                assert!(blobs.is_here(name));
            }
        }
    });
}

#[test]
fn a_blob_that_nobody_stored_is_missing_without_asking() {
    let Some(s3) = S3::start() else { return };
    let dir = tempfile::tempdir().unwrap();
    let blobs = in_store(dir.path(), &s3.address("net"), &s3.variables());
    s3.network.counted("GET");
    let unknown = Digest([7; 32]);
    assert!(!blobs.contains(&unknown));
    assert!(matches!(blobs.get(&unknown, LIMIT), Err(BlobError::Missing(blob)) if blob == unknown));
    assert_eq!(s3.network.counted("GET"), 0);
}

#[test]
fn what_was_only_in_the_folder_is_put_into_the_store() {
    with_stores(|open, inside| {
        let dir = tempfile::tempdir().unwrap();
        let before = Blobs::at(dir.path());
        let kept = before.put(b"weights").unwrap();
        let damaged = before.put(b"damaged").unwrap();
        fs::write(before.path(&damaged), b"Damaged").unwrap();
        let blobs = open(dir.path());
        assert_eq!(blobs.store_all().unwrap(), 1);
        assert_eq!(blobs.store_all().unwrap(), 0);
        assert!(inside.join(kept.to_string()).exists());
        assert!(!inside.join(damaged.to_string()).exists());
        // A blob that is here, and that somebody stores again, is in the store afterwards.
        let late = before.put(b"late").unwrap();
        assert_eq!(blobs.put(b"late").unwrap(), late);
        assert!(inside.join(late.to_string()).exists());
    });
}

/// What is wrong with what the store gives is stated, and nothing of it is kept.
#[test]
fn altered_bytes_are_refused_by_name() {
    with_stores(|open, inside| {
        let dir = tempfile::tempdir().unwrap();
        let blobs = open(dir.path());
        let bytes: Vec<u8> = (0..2 * PART_BYTES + 1000)
            .map(|at| (at % 251) as u8)
            .collect();
        let blob = blobs.put(&bytes).unwrap();
        emptied(dir.path());
        let file = inside.join(blob.to_string());
        let refused = |words: &str| {
            let failed = blobs.get(&blob, LIMIT).unwrap_err();
            assert!(matches!(failed, BlobError::Altered { .. }), "{failed}");
            let reported = failed.to_string();
            assert!(
                reported.contains(&format!("does not hold blob {blob}")),
                "{reported}"
            );
            assert!(
                reported.contains(blobs.store_address().unwrap()),
                "{reported}"
            );
            assert!(reported.contains(words), "{reported}");
            assert_eq!(held(dir.path()), 0);
        };
        let mut other = bytes.clone();
        other[12_000_000] ^= 1;
        fs::write(&file, &other).unwrap();
        refused("bytes of SHA-256");
        other.push(0);
        fs::write(&file, &other).unwrap();
        refused(&format!("{} bytes instead of {}", other.len(), bytes.len()));
        other.truncate(100);
        fs::write(&file, &other).unwrap();
        refused("100 bytes instead of");
        fs::remove_file(&file).unwrap();
        refused("but nothing");

        // The right file heals it.
        fs::write(&file, &bytes).unwrap();
        assert!(blobs.get(&blob, LIMIT).unwrap() == bytes);
    });
}

#[test]
fn a_blob_is_removed_when_those_who_read_it_have_all_of_it() {
    with_stores(|open, inside| {
        let dir = tempfile::tempdir().unwrap();
        let blobs = open(dir.path());
        let bytes = vec![7; 2 * PART_BYTES as usize + 1];
        let blob = blobs.put(&bytes).unwrap();
        emptied(dir.path());
        let shared = &blobs;
        thread::scope(|scope| {
            let mut removal = None;
            let read = shared.fetch_followed(&blob, &mut |_| {
                if removal.is_none() {
                    let (ended, waits) = mpsc::channel();
                    removal = Some(scope.spawn(move || {
                        shared.remove(&blob).unwrap();
                        let _ = ended.send(());
                    }));
                    // It would have removed the blob by then.
                    let early = waits.recv_timeout(Duration::from_millis(300));
                    assert!(early.is_err(), "it does not wait");
                }
                Ok(())
            });
            read.unwrap();
            removal.unwrap().join().unwrap();
        });
        assert!(!blobs.contains(&blob) && !blobs.is_kept(&blob));
        assert!(!inside.join(blob.to_string()).exists());
    });
}

#[test]
fn a_removed_blob_is_in_neither_place() {
    with_stores(|open, inside| {
        let dir = tempfile::tempdir().unwrap();
        let blobs = open(dir.path());
        let blob = blobs.put(b"old").unwrap();
        blobs.remove(&blob).unwrap();
        assert!(!blobs.contains(&blob));
        assert!(!inside.join(blob.to_string()).exists());
        assert!(!open(dir.path()).contains(&blob));
        blobs.remove(&blob).unwrap();
    });
}

#[test]
fn the_folder_shrinks_to_its_limit_and_keeps_what_is_needed_or_only_there() {
    with_stores(|open, _| {
        let dir = tempfile::tempdir().unwrap();
        let blobs = open(dir.path());
        let begun = SystemTime::now();
        let names: Vec<_> = (0..4u8)
            .map(|number| {
                let name = blobs.put(&vec![number; 1000]).unwrap();
                // The times of files have to differ.
                let before = Duration::from_secs(10 - u64::from(number));
                let file = File::open(blobs.path(&name)).unwrap();
                file.set_modified(begun - before).unwrap();
                name
            })
            .collect();
        blobs.get(&names[0], LIMIT).unwrap();
        let only_here = Blobs::at(dir.path()).put(&vec![9; 1000]).unwrap();
        let needed = BTreeSet::from([names[1]]);
        let shrunk = blobs.shrink(3000, &needed).unwrap();
        assert_eq!((shrunk.removed, shrunk.held), (2, 3000));
        // The second is needed, the first was read last.
        let here: Vec<_> = names.iter().map(|name| blobs.is_here(name)).collect();
        assert_eq!(here, [true, true, false, false]);
        let shrunk = blobs.shrink(0, &needed).unwrap();
        assert_eq!((shrunk.removed, shrunk.held), (1, 2000));
        assert!(blobs.is_here(&only_here) && blobs.is_here(&names[1]));
        for (number, name) in names.iter().enumerate() {
            assert_eq!(blobs.get(name, LIMIT).unwrap(), vec![number as u8; 1000]);
        }
        // Without a store, nothing goes.
        let alone = Blobs::at(dir.path());
        assert_eq!(alone.shrink(0, &BTreeSet::new()).unwrap().removed, 0);
        assert!(alone.is_here(&names[0]));
    });
}

#[test]
fn a_blob_that_many_ask_for_is_read_once() {
    let Some(s3) = S3::start() else { return };
    let dir = tempfile::tempdir().unwrap();
    let blobs = in_store(dir.path(), &s3.address("net"), &s3.variables());
    let blob = blobs.put(b"base").unwrap();
    emptied(dir.path());
    s3.network.counted("GET");
    let barrier = Barrier::new(8);
    thread::scope(|scope| {
        for _ in 0..8 {
            scope.spawn(|| {
                barrier.wait();
                assert_eq!(blobs.get(&blob, LIMIT).unwrap(), b"base");
            });
        }
    });
    assert_eq!(s3.network.counted("GET"), 1);
}

#[test]
fn a_reader_beside_the_writer_finds_what_comes_and_misses_what_goes() {
    let folder = tempfile::tempdir().unwrap();
    let local = (format!("file://{}", folder.path().display()), Vec::new());
    let s3 = S3::start();
    let remote = s3.as_ref().map(|s3| (s3.address("net"), s3.variables()));
    for (address, variables) in [Some(local), remote].into_iter().flatten() {
        let (here, there) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let writer = in_store(here.path(), &address, &variables);
        let old = writer.put(b"old").unwrap();
        let reader = reader(there.path(), &address, &variables);
        let new = writer.put(b"new").unwrap();
        assert_eq!(reader.get(&new, LIMIT).unwrap(), b"new");
        writer.remove(&old).unwrap();
        let gone = reader.get(&old, LIMIT);
        assert!(
            matches!(gone, Err(BlobError::Missing(blob)) if blob == old),
            "{gone:?}"
        );
        // What it has read is in the store, so its folder may shrink.
        assert_eq!(reader.shrink(0, &BTreeSet::new()).unwrap().removed, 1);
    }
}

#[test]
fn a_blob_that_is_read_once_is_verified_and_does_not_stay() {
    with_stores(|open, inside| {
        let dir = tempfile::tempdir().unwrap();
        let blobs = open(dir.path());
        let blob = blobs.put(b"weights").unwrap();
        emptied(dir.path());
        let mut bytes = Vec::new();
        let mut file = blobs.file_once(&blob).unwrap();
        file.read_to_end(&mut bytes).unwrap();
        assert_eq!(bytes, b"weights");
        assert_eq!(held(dir.path()), 0);
        fs::write(inside.join(blob.to_string()), b"Weights").unwrap();
        let refused = blobs.file_once(&blob);
        assert!(
            matches!(refused, Err(BlobError::Altered { .. })),
            "{refused:?}"
        );
    });
}

#[test]
fn what_a_store_was_asked_for_is_counted() {
    with_stores(|open, inside| {
        let dir = tempfile::tempdir().unwrap();
        let blobs = open(dir.path());
        let done = |operation| blobs.usage().unwrap().of(operation).done;
        assert_eq!(done(StoreOperation::List), 1);
        let blob = blobs.put(b"weights").unwrap();
        blobs.put(b"weights").unwrap();
        let put = blobs.usage().unwrap().of(StoreOperation::Put);
        assert_eq!((put.done, put.failed, put.bytes), (1, 0, 7));
        assert!(put.time > Duration::ZERO);
        assert_eq!(blobs.stored(), Some(blobs.here().unwrap()));
        assert_eq!(blobs.stored().unwrap().bytes, 7);

        emptied(dir.path());
        assert_eq!(blobs.here().unwrap().blobs, 0);
        fs::write(inside.join(blob.to_string()), b"Weights").unwrap();
        assert!(blobs.get(&blob, LIMIT).is_err());
        fs::write(inside.join(blob.to_string()), b"weights").unwrap();
        assert!(blobs.get(&blob, LIMIT).is_ok());
        let get = blobs.usage().unwrap().of(StoreOperation::Get);
        assert_eq!((get.done, get.altered, get.bytes), (1, 1, 7));
        assert_eq!(blobs.usage().unwrap().failing(), None);
        blobs.remove(&blob).unwrap();
        assert_eq!(done(StoreOperation::Remove), 1);
        assert_eq!(blobs.stored().unwrap().blobs, 0);
    });
    assert_eq!(Blobs::at(Path::new("/")).usage(), None);
}

#[test]
fn what_is_no_address_of_a_store_is_refused() {
    let patience = RetryPeriod(Duration::from_secs(1));
    for (address, words) in [
        ("bucket", "is not the address of a blob store"),
        ("http://example.com/x", "names no store of objects"),
        ("memory:///x", "names no store of objects"),
        ("s3://user:secret@bucket/x", "holds no credentials"),
        ("az://container/x?sig=secret", "holds no credentials"),
        ("az://container/x", "cannot be opened"),
    ] {
        let refused = Bucket::open(address, &[], patience)
            .unwrap_err()
            .to_string();
        assert!(refused.contains(words), "{address}: {refused}");
        assert!(!refused.contains("secret"), "{refused}");
    }
}
