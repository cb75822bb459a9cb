//! A bucket behind a network and a server that fail: what is tried again, what is not, and that nothing is half kept.

use crate::bucket::cache::{emptied, held};
use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};
use zk0_ledger::blobs::usage::StoreOperation;
use zk0_ledger::blobs::{BlobError, Blobs};
use zk0_ledger::bucket::waiting::RetryPeriod;
use zk0_ledger::bucket::Bucket;
use zk0_ledger::bucket::PART_BYTES;
use zk0_testkit::s3::failing_network::Fault;
use zk0_testkit::s3::S3;

const PATIENCE: RetryPeriod = RetryPeriod(Duration::from_secs(120));
const SHORT: RetryPeriod = RetryPeriod(Duration::from_secs(2));
const LIMIT: u64 = 1 << 30;

fn blobs(s3: &S3, dir: &Path, patience: RetryPeriod) -> Blobs {
    let bucket = Bucket::open(&s3.address("net"), &s3.variables(), patience).unwrap();
    Blobs::in_store(dir, Box::new(bucket)).unwrap()
}

/// Bytes that take two parts and a bit.
fn large() -> Vec<u8> {
    (0..2 * PART_BYTES + 1000)
        .map(|at| (at % 251) as u8)
        .collect()
}

#[test]
fn an_answer_of_503_is_tried_again() {
    let Some(s3) = S3::start() else { return };
    let dir = tempfile::tempdir().unwrap();
    let blobs = blobs(&s3, dir.path(), PATIENCE);
    s3.network.counted("PUT");
    s3.network.fail_next("PUT", Fault::Unavailable, 2);
    let blob = blobs.put(b"proof").unwrap();
    assert_eq!(s3.network.counted("PUT"), 3);
    assert_eq!(fs::read(s3.file("net", blob)).unwrap(), b"proof");

    emptied(dir.path());
    s3.network.fail_next("GET", Fault::Unavailable, 2);
    assert_eq!(blobs.get(&blob, LIMIT).unwrap(), b"proof");
    assert!(s3.network.has_failed());
}

#[test]
fn a_store_that_stays_unavailable_keeps_nothing_and_says_so() {
    let Some(s3) = S3::start() else { return };
    let dir = tempfile::tempdir().unwrap();
    let blobs = blobs(&s3, dir.path(), SHORT);
    s3.network.fail_always(Fault::Unavailable);
    for bytes in [b"proof".to_vec(), large()] {
        let begun = Instant::now();
        let failed = blobs.put(&bytes).unwrap_err();
        assert!(matches!(failed, BlobError::Store(_)), "{failed}");
        let reported = failed.to_string();
        let expected = format!("the blob store {} failed: storing blob", s3.address("net"));
        assert!(reported.starts_with(&expected), "{reported}");
        assert!(reported.contains("503"), "{reported}");
        assert!(
            begun.elapsed() < Duration::from_secs(20),
            "{:?}",
            begun.elapsed()
        );
    }
    assert_eq!(held(dir.path()), 0);
    let usage = blobs.usage().unwrap();
    let put = usage.of(StoreOperation::Put);
    assert_eq!((put.done, put.failed, put.bytes), (0, 2, 0));
    let failing = usage.failing().unwrap();
    // It has failed since the first of them failed.
    assert!(failing > Duration::from_secs(1), "{failing:?}");

    s3.network.mend();
    blobs.put(b"proof").unwrap();
    assert_eq!(blobs.usage().unwrap().failing(), None);
    let blobs = self::blobs(&s3, dir.path(), PATIENCE);
    let blob = blobs.put(&large()).unwrap();
    emptied(dir.path());
    assert_eq!(blobs.get(&blob, LIMIT).unwrap(), large());
}

#[test]
fn a_server_that_does_not_answer_is_given_up() {
    let Some(s3) = S3::start() else { return };
    let dir = tempfile::tempdir().unwrap();
    let blobs = blobs(&s3, dir.path(), SHORT);
    let blob = blobs.put(b"proof").unwrap();
    emptied(dir.path());
    s3.network.fail_always(Fault::Silent);
    let begun = Instant::now();
    let failed = blobs.get(&blob, LIMIT).unwrap_err();
    assert!(matches!(failed, BlobError::Store(_)), "{failed}");
    assert!(
        failed.to_string().contains(&format!("reading blob {blob}")),
        "{failed}"
    );
    assert!(
        begun.elapsed() < Duration::from_secs(15),
        "{:?}",
        begun.elapsed()
    );
    assert_eq!(held(dir.path()), 0);
}

#[test]
fn a_download_that_is_cut_goes_on() {
    let Some(s3) = S3::start() else { return };
    let dir = tempfile::tempdir().unwrap();
    let blobs = blobs(&s3, dir.path(), PATIENCE);
    let blob = blobs.put(&large()).unwrap();
    emptied(dir.path());
    s3.network.fail_next("GET", Fault::CutAnswer(500_000), 1);
    s3.network.fail_next("GET", Fault::CutAnswer(3_000_000), 1);
    assert_eq!(blobs.get(&blob, LIMIT).unwrap(), large());
    assert!(s3.network.has_failed());
}

#[test]
fn an_upload_that_is_cut_is_tried_again() {
    let Some(s3) = S3::start() else { return };
    let dir = tempfile::tempdir().unwrap();
    let blobs = blobs(&s3, dir.path(), PATIENCE);
    s3.network.fail_next("PUT", Fault::CutRequest(1_000_000), 2);
    let blob = blobs.put(&large()).unwrap();
    assert!(s3.network.has_failed());
    s3.network.fail_next("PUT", Fault::CutRequest(10), 1);
    let small = blobs.put(&vec![7; 100_000]).unwrap();
    assert!(s3.network.has_failed());
    emptied(dir.path());
    assert_eq!(blobs.get(&blob, LIMIT).unwrap(), large());
    assert_eq!(blobs.get(&small, LIMIT).unwrap(), vec![7; 100_000]);
}

/// The parts are an object then, and whoever asks for that once more is told that there are no parts.
#[test]
fn an_answer_that_is_lost_at_the_end_of_an_upload_costs_nothing() {
    let Some(s3) = S3::start() else { return };
    let dir = tempfile::tempdir().unwrap();
    let blobs = blobs(&s3, dir.path(), PATIENCE);
    // The first such request begins the upload.
    s3.network.pass_next("POST /blobs/net/blobs/", 1);
    s3.network
        .fail_next("POST /blobs/net/blobs/", Fault::CutAnswer(200), 1);
    s3.network.counted("PUT");
    let blob = blobs.put(&large()).unwrap();
    assert!(s3.network.has_failed());
    let parts = large().len().div_ceil(PART_BYTES as usize);
    assert_eq!(s3.network.counted("PUT"), parts);
    assert_eq!(fs::read(s3.file("net", blob)).unwrap(), large());
}

#[test]
fn an_upload_that_fails_leaves_no_parts_behind() {
    let Some(s3) = S3::start() else { return };
    let dir = tempfile::tempdir().unwrap();
    let blobs = blobs(&s3, dir.path(), RetryPeriod(Duration::from_secs(6)));
    // The first part comes through, and no other.
    s3.network.pass_next("PUT", 1);
    s3.network.fail_next("PUT", Fault::Unavailable, 1000);
    assert!(blobs.put(&large()).is_err());
    assert_eq!(s3.unfinished(), 0);
    assert_eq!(held(dir.path()), 0);

    // If its parts cannot be removed either, they stay. The test looks for them in the right place.
    s3.network.mend();
    s3.network.pass_next("PUT", 1);
    s3.network.fail_next("PUT", Fault::Unavailable, 1000);
    s3.network.fail_next("DELETE", Fault::Unavailable, 1000);
    assert!(blobs.put(&large()).is_err());
    assert_eq!(s3.unfinished(), 1);
}

#[test]
fn wrong_credentials_are_named_and_not_tried_again() {
    let Some(s3) = S3::start() else { return };
    let dir = tempfile::tempdir().unwrap();
    let variables = s3.variables_with("another secret");
    let bucket = Bucket::open(&s3.address("net"), &variables, PATIENCE).unwrap();
    let begun = Instant::now();
    let failed = Blobs::in_store(dir.path(), Box::new(bucket)).unwrap_err();
    assert!(
        failed.to_string().contains("it refuses the credentials"),
        "{failed}"
    );
    assert!(
        begun.elapsed() < Duration::from_secs(5),
        "{:?}",
        begun.elapsed()
    );
    assert_eq!(s3.network.counted("GET"), 1);
}

#[test]
fn a_bucket_that_does_not_exist_is_named() {
    let Some(s3) = S3::start() else { return };
    let dir = tempfile::tempdir().unwrap();
    let bucket = Bucket::open("s3://other/net", &s3.variables(), PATIENCE).unwrap();
    let failed = Blobs::in_store(dir.path(), Box::new(bucket)).unwrap_err();
    assert!(failed.to_string().contains("s3://other/net"), "{failed}");
    assert!(failed.to_string().contains("no such bucket"), "{failed}");
}
