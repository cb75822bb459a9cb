//! Groups of entries in a store. Each is written once, whole, and found again by its first entry.

use std::fs;
use std::time::Duration;
use zk0_ledger::blobs::entry_objects::EntryStore;
use zk0_ledger::blobs::store::BlobStore;
use zk0_ledger::bucket::waiting::RetryPeriod;
use zk0_ledger::bucket::Bucket;
use zk0_testkit::s3::S3;

fn are_written_once(address: &str, variables: &[(String, String)]) {
    let patience = RetryPeriod(Duration::from_secs(120));
    let open = || Bucket::open(address, variables, patience).unwrap();
    let (ours, theirs) = (open(), open());
    assert_eq!(ours.place(), address);
    assert!(ours.groups_from(0).unwrap().is_empty());
    assert_eq!(ours.group(7).unwrap(), None);
    let large = vec![1; 9 << 20];
    for first in [0, 2, 7, 10] {
        assert!(ours.create_group(first, &[first as u8]).unwrap());
    }
    assert!(ours.create_group(1000, &large).unwrap());
    for again in [&ours, &theirs] {
        assert!(!again.create_group(7, b"other").unwrap());
    }
    assert_eq!(theirs.group(7).unwrap().unwrap(), [7]);
    assert!(theirs.group(1000).unwrap().unwrap() == large);
    let from = |first| {
        let mut groups = theirs.groups_from(first).unwrap();
        groups.sort_unstable();
        groups
    };
    assert_eq!(from(0), [0, 2, 7, 10, 1000]);
    assert_eq!(from(3), [7, 10, 1000]);
    assert_eq!(from(7), [7, 10, 1000]);
    assert!(from(1001).is_empty());
    assert_eq!(theirs.pruned().unwrap(), None);
    for statement in [b"first", b"later"] {
        ours.put_pruned(statement).unwrap();
        assert_eq!(theirs.pruned().unwrap().unwrap(), statement);
    }
    // They are no blobs.
    assert!(ours.all().unwrap().is_empty());
}

#[test]
fn groups_in_a_folder_are_written_once() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("a/net");
    are_written_once(&format!("file://{}", root.display()), &[]);
    // Nothing is left of what was refused.
    assert_eq!(fs::read_dir(root.join("entries")).unwrap().count(), 5);
}

#[test]
fn groups_in_a_bucket_are_written_once() {
    for bucket in [S3::start(), S3::start_as_google()].into_iter().flatten() {
        are_written_once(&bucket.address("a/net"), &bucket.variables());
    }
}
