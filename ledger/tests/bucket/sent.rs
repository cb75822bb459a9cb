//! Files that others put into a bucket by themselves, at addresses that it has signed for them.

use std::fs;
use std::sync::atomic::AtomicBool;
use std::thread::{self, sleep};
use std::time::{Duration, Instant};
use tempfile::TempDir;
use zk0_circuits::NodeId;
use zk0_ledger::blobs::usage::StoreOperation;
use zk0_ledger::blobs::{BlobError, Blobs};
use zk0_ledger::bucket::waiting::RetryPeriod;
use zk0_ledger::bucket::Bucket;
use zk0_ledger::bucket::PART_BYTES;
use zk0_protocol::blob::blob_digest;
use zk0_testkit::s3::failing_network::Fault;
use zk0_testkit::s3::{send, send_in_parts, S3};
use zk0_testkit::until;

const NODE: NodeId = NodeId([7; 32]);
const MINUTE: Duration = Duration::from_secs(60);

/// A bucket, and the folder of a ledger whose blobs are kept there.
struct Kept {
    s3: S3,
    dir: TempDir,
    blobs: Blobs,
}

impl Kept {
    fn with_patience(seconds: u64) -> Option<Self> {
        Some(Self::of(S3::start()?, seconds))
    }

    fn of(s3: S3, seconds: u64) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let patience = RetryPeriod(Duration::from_secs(seconds));
        let bucket = Bucket::open(&s3.address("net"), &s3.variables(), patience).unwrap();
        let blobs = Blobs::in_store(dir.path(), Box::new(bucket)).unwrap();
        Self { s3, dir, blobs }
    }

    fn new() -> Option<Self> {
        Self::with_patience(120)
    }

    /// The same after a new start.
    fn again(mut self) -> Self {
        let patience = RetryPeriod(MINUTE);
        let bucket = Bucket::open(&self.s3.address("net"), &self.s3.variables(), patience);
        self.blobs = Blobs::in_store(self.dir.path(), Box::new(bucket.unwrap())).unwrap();
        self
    }

    fn address(&self, valid: Duration) -> String {
        self.blobs.address(0, NODE, valid).unwrap().unwrap()
    }

    /// Where uploads wait.
    fn staged(&self) -> Blobs {
        Blobs::at(&self.dir.path().join("staged"))
    }

    /// Takes what the node has sent, if it is this.
    fn take(&self, expected: &[u8]) -> Result<(), BlobError> {
        let (digest, size) = (blob_digest(expected), expected.len() as u64);
        let partial = self.staged().partial(&digest, size).unwrap();
        let stopped = AtomicBool::new(false);
        self.blobs
            .take_sent((0, NODE), (&digest, size), partial, &stopped)
    }

    /// How many objects of the bucket are no blobs yet.
    fn unverified(&self) -> usize {
        self.s3.objects("net/uploads")
    }

    /// Makes a blob of what waits, and returns what the bucket has then.
    fn linked(&self, bytes: &[u8]) -> Vec<u8> {
        let digest = blob_digest(bytes);
        self.blobs.link(&self.staged(), &digest).unwrap();
        fs::read(self.s3.file("net", digest)).unwrap()
    }
}

/// Bytes that take two parts and a bit.
fn large() -> Vec<u8> {
    (0..2 * PART_BYTES + 1000)
        .map(|at| (at % 251) as u8)
        .collect()
}

#[test]
fn what_a_node_has_put_there_becomes_a_blob_and_is_not_sent_again() {
    let Some(kept) = Kept::new() else { return };
    for bytes in [b"update".to_vec(), large()] {
        assert_eq!(send("PUT", &kept.address(MINUTE), &bytes), 200);
        kept.take(&bytes).unwrap();
        assert_eq!(
            kept.staged().get(&blob_digest(&bytes), 1 << 30).unwrap(),
            bytes
        );
        // It is under no name of a blob before somebody states it.
        assert!(!kept.s3.file("net", blob_digest(&bytes)).exists());
        assert_eq!(kept.unverified(), 1);
        assert!(kept.linked(&bytes) == bytes);
        assert_eq!(kept.unverified(), 0);
        // Large blobs are sent in parts, which begins with such a request.
        let parts = "POST /blobs/net/blobs/";
        assert_eq!(kept.s3.network.counted(parts), 0);
    }
    assert_eq!(kept.blobs.usage().unwrap().of(StoreOperation::Put).done, 2);
    // What nobody has put there is sent.
    let mut bytes = large();
    bytes[0] ^= 1;
    kept.blobs.put(&bytes[..]).unwrap();
    assert_eq!(kept.s3.network.counted("POST /blobs/net/blobs/"), 2);
}

#[test]
fn a_bucket_of_google_gives_addresses_and_copies() {
    let Some(google) = S3::start_as_google() else {
        return;
    };
    let kept = Kept::of(google, 60);
    for bytes in [b"update".to_vec(), large()] {
        let address = kept.address(MINUTE);
        assert!(address.contains("X-Goog-Signature="), "{address}");
        assert_eq!(send("PUT", &address, &bytes), 200);
        kept.take(&bytes).unwrap();
        assert_eq!(kept.unverified(), 1);
        assert!(kept.linked(&bytes) == bytes);
        assert_eq!(kept.unverified(), 0);
    }
}

/// The address is valid for minutes, and its node may go on to write there.
#[test]
fn what_changes_after_it_was_verified_does_not_become_the_blob() {
    let Some(kept) = Kept::new() else { return };
    let address = kept.address(MINUTE);
    assert_eq!(send("PUT", &address, b"update"), 200);
    kept.take(b"update").unwrap();
    assert_eq!(send("PUT", &address, b"poison"), 200);
    assert_eq!(kept.linked(b"update"), b"update");
}

#[test]
fn what_is_not_the_update_is_refused_by_name_and_not_kept() {
    let Some(kept) = Kept::new() else { return };
    let nothing_left = || {
        assert_eq!(kept.unverified(), 0);
        assert_eq!(kept.staged().count(), 0);
    };
    let refused = kept.take(b"update").unwrap_err();
    assert!(matches!(refused, BlobError::NotSent), "{refused}");
    nothing_left();
    let address = kept.address(MINUTE);
    for other in [&b"updates"[..], b"updat", b""] {
        assert_eq!(send("PUT", &address, other), 200);
        let refused = kept.take(b"update").unwrap_err();
        let found = other.len() as u64;
        assert!(
            matches!(refused, BlobError::OtherSize { found: one, size: 6 } if one == found),
            "{refused}"
        );
        nothing_left();
    }
    assert_eq!(send("PUT", &address, b"Update"), 200);
    let refused = kept.take(b"update").unwrap_err();
    assert!(
        matches!(refused, BlobError::WrongDigest { .. }),
        "{refused}"
    );
    nothing_left();
    // The right bytes come through afterwards.
    assert_eq!(send("PUT", &address, b"update"), 200);
    kept.take(b"update").unwrap();
    assert_eq!(kept.linked(b"update"), b"update");
}

/// The tests' server does what S3 does: an address is for one method, one object and one time.
#[test]
fn an_address_is_good_for_nothing_else() {
    let Some(kept) = Kept::new() else { return };
    let address = kept.address(MINUTE);
    let other = address.replace(&NODE.to_string(), &NodeId([8; 32]).to_string());
    assert_eq!(send("PUT", &other, b"update"), 403);
    for method in ["GET", "DELETE"] {
        assert_eq!(send(method, &address, b""), 403);
    }
    let short = kept.address(Duration::from_secs(1));
    sleep(Duration::from_millis(2100));
    assert_eq!(send("PUT", &short, b"update"), 403);
    assert!(matches!(kept.take(b"update"), Err(BlobError::NotSent)));
    assert_eq!(kept.unverified(), 0);
}

/// S3 may answer with status 200 and an error after it, and Azure may go on copying after its answer.
#[test]
fn a_copy_that_is_only_said_to_be_made_is_none() {
    let Some(kept) = Kept::with_patience(2) else {
        return;
    };
    let (to_copies, to_blobs) = ("PUT /blobs/net/uploads/0/copy-", "PUT /blobs/net/blobs/");
    assert_eq!(send("PUT", &kept.address(MINUTE), b"update"), 200);
    kept.s3
        .network
        .fail_next(to_copies, Fault::Claimed(None), 1);
    let failed = kept.take(b"update").unwrap_err().to_string();
    assert!(
        failed.contains("it states that it has copied 6 bytes, and there is nothing"),
        "{failed}"
    );
    // What the node has put there stays.
    assert_eq!(kept.unverified(), 1);
    let later = Fault::Claimed(Some(Duration::from_millis(500)));
    kept.s3.network.fail_next(to_copies, later, 1);
    kept.take(b"update").unwrap();
    kept.s3.network.counted("PUT");
    kept.s3.network.fail_next(to_blobs, Fault::Claimed(None), 1);
    assert_eq!(kept.linked(b"update"), b"update");
    assert!(kept.s3.network.has_failed());
    // The blob is sent instead.
    assert_eq!(kept.s3.network.counted(to_blobs), 2);
    assert_eq!(kept.unverified(), 0);
}

/// Otherwise a node that replaces its object again and again would leave many copies, and hold one of the few threads for each.
#[test]
fn a_copy_of_what_has_grown_is_given_up_at_once_and_removed() {
    let Some(kept) = Kept::new() else { return };
    let address = kept.address(MINUTE);
    assert_eq!(send("PUT", &address, b"update"), 200);
    let to_copies = "PUT /blobs/net/uploads/0/copy-";
    let late = Fault::Late(Duration::from_secs(1));
    kept.s3.network.fail_next(to_copies, late, 1);
    let begun = Instant::now();
    let failed = thread::scope(|scope| {
        let taking = scope.spawn(|| kept.take(b"update").unwrap_err().to_string());
        // The size was right, and the copy is on its way.
        until("it is copied", || kept.s3.network.counted(to_copies) > 0);
        assert_eq!(send("PUT", &address, b"much more"), 200);
        taking.join().unwrap()
    });
    assert!(failed.contains("copied 6 bytes"), "{failed}");
    assert!(failed.contains("9 bytes"), "{failed}");
    let elapsed = begun.elapsed();
    assert!(elapsed < Duration::from_secs(15), "{elapsed:?}");
    // What the node has put there is the only object.
    assert_eq!(kept.unverified(), 1);
}

#[test]
fn a_copy_that_nobody_can_look_at_is_removed() {
    let Some(kept) = Kept::with_patience(2) else {
        return;
    };
    assert_eq!(send("PUT", &kept.address(MINUTE), b"update"), 200);
    // The size of what the node has put there is asked for, and then that of the copy.
    kept.s3.network.pass_next("HEAD", 1);
    kept.s3.network.fail_next("HEAD", Fault::Unavailable, 1000);
    kept.s3.network.counted("PUT");
    let failed = kept.take(b"update").unwrap_err().to_string();
    assert!(failed.contains("copying upload 0/0707"), "{failed}");
    assert_eq!(kept.s3.network.counted("PUT"), 1);
    assert_eq!(kept.unverified(), 1);
    kept.s3.network.mend();
    kept.take(b"update").unwrap();
    assert_eq!(kept.linked(b"update"), b"update");
    assert_eq!(kept.unverified(), 0);
}

/// A slow node needs longer for its update than its address is valid.
#[test]
fn what_begins_in_time_may_end_later() {
    let Some(kept) = Kept::new() else { return };
    let bytes = large();
    let address = kept.address(Duration::from_secs(1));
    let (first, rest) = bytes.split_at(bytes.len() / 2);
    let status = send_in_parts("PUT", &address, &[first, rest], Duration::from_millis(2100));
    assert_eq!(status, 200);
    assert_eq!(send("PUT", &address, &bytes), 403);
    kept.take(&bytes).unwrap();
}

#[test]
fn a_store_that_fails_says_so_and_what_was_read_is_not_read_twice() {
    let Some(kept) = Kept::with_patience(5) else {
        return;
    };
    let bytes = large();
    assert_eq!(send("PUT", &kept.address(MINUTE), &bytes), 200);
    kept.s3.network.fail_always(Fault::Unavailable);
    let failed = kept.take(&bytes).unwrap_err();
    assert!(matches!(failed, BlobError::Store(_)), "{failed}");
    assert!(failed.to_string().contains("upload 0/0707"), "{failed}");
    assert_eq!(kept.staged().count(), 0);
    kept.s3.network.mend();
    kept.s3.network.pass_next("GET", 1);
    kept.s3.network.fail_next("GET", Fault::Unavailable, 1000);
    let failed = kept.take(&bytes).unwrap_err();
    assert!(matches!(failed, BlobError::Store(_)), "{failed}");
    kept.s3.network.mend();
    assert_eq!(kept.unverified(), 0);
    let held = kept.staged().held(&blob_digest(&bytes)).unwrap();
    assert_eq!(held, PART_BYTES);
}

#[test]
fn a_copy_that_is_lost_costs_one_more_transfer() {
    let Some(kept) = Kept::new() else { return };
    assert_eq!(send("PUT", &kept.address(MINUTE), b"update"), 200);
    kept.take(b"update").unwrap();
    fs::remove_dir_all(kept.s3.root("net/uploads")).unwrap();
    assert_eq!(kept.linked(b"update"), b"update");
    // So does a new start, after which nobody knows the copy.
    assert_eq!(send("PUT", &kept.address(MINUTE), b"another"), 200);
    kept.take(b"another").unwrap();
    let kept = kept.again();
    assert_eq!(kept.linked(b"another"), b"another");
    assert_eq!(kept.unverified(), 1);
    assert_eq!(kept.blobs.remove_sent(None).unwrap(), 1);
    assert_eq!(kept.unverified(), 0);
}

/// A store that copies slowly states that a copy is made while it still has another one under that name.
#[test]
fn a_copy_of_an_earlier_run_is_not_taken_for_a_new_one() {
    let Some(kept) = Kept::new() else { return };
    assert_eq!(send("PUT", &kept.address(MINUTE), b"before"), 200);
    kept.take(b"before").unwrap();
    let kept = kept.again();
    assert_eq!(send("PUT", &kept.address(MINUTE), b"update"), 200);
    let later = Fault::Claimed(Some(Duration::from_millis(500)));
    let to_copies = "PUT /blobs/net/uploads/0/copy-";
    kept.s3.network.fail_next(to_copies, later, 1);
    kept.take(b"update").unwrap();
    assert!(kept.s3.network.has_failed());
}

#[test]
fn what_ended_rounds_leave_is_removed() {
    let Some(kept) = Kept::new() else { return };
    for round in [3, 4] {
        let address = kept.blobs.address(round, NODE, MINUTE).unwrap().unwrap();
        assert_eq!(send("PUT", &address, b"update"), 200);
    }
    assert_eq!(kept.blobs.remove_sent(Some(4)).unwrap(), 1);
    assert_eq!(kept.unverified(), 1);
    assert_eq!(kept.blobs.remove_sent(None).unwrap(), 1);
    assert_eq!(kept.unverified(), 0);
}

#[test]
fn a_folder_signs_no_addresses() {
    let (dir, folder) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let address = format!("file://{}", folder.path().display());
    let bucket = Bucket::open(&address, &[], RetryPeriod(MINUTE)).unwrap();
    let blobs = Blobs::in_store(dir.path(), Box::new(bucket)).unwrap();
    assert!(!blobs.takes_sent());
    assert_eq!(blobs.address(0, NODE, MINUTE).unwrap(), None);
    assert!(!Blobs::at(dir.path()).takes_sent());
}
