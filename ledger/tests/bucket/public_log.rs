//! A log that is published in a bucket, and read from there by anybody over HTTP.

use std::env;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;
use zk0_ledger::bucket::public_log::PublicLog;
use zk0_ledger::bucket::waiting::RetryPeriod;
use zk0_ledger::published::export::{export_to, ExportError, Exported};
use zk0_ledger::published::mirror::mirror;
use zk0_ledger::published::publication::Publication;
use zk0_ledger::published::source::{FolderSource, LogSource};
use zk0_ledger::published::web::Web;
use zk0_ledger::{replay, Blobs};
use zk0_protocol::tlog::layout::{tiles, Resource, Tile, TileKind};
use zk0_testkit::s3::failing_network::Fault;
use zk0_testkit::s3::S3;

/// A ledger with a real proof.
fn real() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/fixtures/ledger")
}

fn opened(s3: &S3, seconds: u64) -> PublicLog {
    let patience = RetryPeriod(Duration::from_secs(seconds));
    PublicLog::open(&s3.address("a/log"), &s3.variables(), patience).unwrap()
}

fn in_folder(folder: &Path) -> PublicLog {
    let address = format!("file://{}", folder.display());
    PublicLog::open(&address, &[], RetryPeriod(Duration::from_secs(1))).unwrap()
}

fn published(place: &mut PublicLog) -> Result<Exported, ExportError> {
    export_to(&Publication::open(&real(), None).unwrap(), place)
}

/// Makes a ledger of what `source` publishes, and checks that it is the same.
fn is_mirrored(source: &dyn LogSource) {
    let copy = tempfile::tempdir().unwrap();
    let done = mirror(source, copy.path(), None, None).unwrap();
    assert_eq!(done.missing_blobs, 0);
    let (ours, theirs) = (
        replay(&real(), None, &mut ()),
        replay(copy.path(), None, &mut ()),
    );
    assert_eq!(ours.entries, theirs.entries);
    assert_eq!(ours.root, theirs.root);
}

#[test]
fn anybody_mirrors_a_log_from_the_bucket() {
    let Some(s3) = S3::start() else { return };
    let done = published(&mut opened(&s3, 120)).unwrap();
    assert_eq!(done.tiles, tiles(done.entries).count() as u64);
    assert_eq!(done.missing_blobs, 0);
    let open = s3.open_to_all();
    is_mirrored(&Web::at(&open.url("a/log"), None).unwrap());

    // Another process finds what is there, and writes nothing but what may have changed.
    s3.network.counted("PUT");
    let again = published(&mut opened(&s3, 120)).unwrap();
    assert_eq!((again.tiles, again.blobs), (0, 0));
    assert_eq!(s3.network.counted("PUT"), 2);
}

#[test]
fn a_folder_holds_the_same_log() {
    let folder = tempfile::tempdir().unwrap();
    published(&mut in_folder(&folder.path().join("log"))).unwrap();
    is_mirrored(&FolderSource::at(&folder.path().join("log")));
}

/// A file that an earlier release has written may have lost its bytes in a power cut.
#[test]
fn what_has_lost_bytes_is_written_again_at_the_next_start() {
    let dir = tempfile::tempdir().unwrap();
    let log = dir.path().join("log");
    let done = published(&mut in_folder(&log)).unwrap();
    let damaged = |path: &str, left: u64| {
        let file = File::options().write(true).open(log.join(path)).unwrap();
        assert!(file.metadata().unwrap().len() > left, "{path}");
        file.set_len(left).unwrap();
    };
    let view = Publication::open(&real(), None).unwrap();
    let of_kind = |kind| Tile::at(kind, 0, done.entries).unwrap();
    damaged(&of_kind(TileKind::Hashes(0)).to_string(), 0);
    damaged(&of_kind(TileKind::Entries).to_string(), 2);
    let public: Vec<_> = view.public_blobs().copied().collect();
    for (blob, left) in public.iter().zip([0, 100]) {
        damaged(&Resource::Blob(*blob).to_string(), left);
    }
    let again = published(&mut in_folder(&log)).unwrap();
    assert_eq!(again.tiles, 2);
    assert_eq!(again.blobs, public.len().min(2) as u64);
    is_mirrored(&FolderSource::at(&log));
    let again = published(&mut in_folder(&log)).unwrap();
    assert_eq!((again.tiles, again.blobs), (0, 0));
}

/// The folder into which the child process of a test writes a log.
const CHILD: &str = "ZK0_TEST_PUBLISH_INTO";

/// This is not a test of its own. The child process of the test below runs it.
#[test]
#[ignore = "run by another test as a child process"]
fn publish_into_a_folder() {
    let Some(folder) = env::var_os(CHILD) else {
        return;
    };
    published(&mut in_folder(Path::new(&folder))).unwrap();
}

#[test]
fn a_file_in_a_folder_has_its_bytes_on_the_disk_before_its_name() {
    let dir = tempfile::tempdir().unwrap();
    let here = dir.path().canonicalize().unwrap();
    let (log, calls) = (here.join("log"), here.join("calls"));
    let traced = Command::new("strace")
        .args(["-f", "-y", "-s", "4096", "-e"])
        .arg("trace=?fsync,?fdatasync,?rename,?renameat,?renameat2")
        .arg("-o")
        .arg(&calls)
        .arg(env::current_exe().unwrap())
        .args([
            "--exact",
            "bucket::public_log::publish_into_a_folder",
            "--ignored",
        ])
        .env(CHILD, &log)
        .stdout(Stdio::null())
        .status();
    if traced
        .as_ref()
        .is_err_and(|error| error.kind() == io::ErrorKind::NotFound)
    {
        zk0_testkit::skipped::skipped("there is no strace; scripts/setup.sh guest installs it");
        return;
    }
    assert!(traced.unwrap().success());
    let calls = fs::read_to_string(calls).unwrap();
    let calls: Vec<_> = calls.lines().collect();
    let mut named = 0;
    for (at, call) in calls.iter().enumerate() {
        // The first path is the old one.
        let Some(from) = call.split('"').nth(1).filter(|_| call.contains("rename")) else {
            continue;
        };
        if !Path::new(from).starts_with(&log) {
            continue;
        }
        let file = format!("<{from}>");
        let synced = |call: &&str| call.contains("sync(") && call.contains(&file);
        assert!(calls[..at].iter().any(synced), "{call}");
        named += 1;
    }
    // There are at least one tile of each kind, the policy and the checkpoint.
    assert!(named >= 5, "{calls:?}");
}

/// A reader of the checkpoint finds all that it covers, wherever the network fails.
#[test]
fn the_checkpoint_is_written_last() {
    let Some(s3) = S3::start() else { return };
    let checkpoint = s3.root("a/log").join("checkpoint");
    let mut place = opened(&s3, 1);
    s3.network.counted("PUT");
    for passed in [0, 1, 2] {
        s3.network.pass_next("PUT", passed);
        s3.network.fail_next("PUT", Fault::Unavailable, 1000);
        let failed = published(&mut place).unwrap_err().to_string();
        assert!(failed.contains("the blob store s3://"), "{failed}");
        assert!(failed.contains("publishing "), "{failed}");
        assert!(!checkpoint.exists());
        s3.network.mend();
    }
    // What has come through is not sent again.
    s3.network.counted("PUT");
    let done = published(&mut place).unwrap();
    let sent = s3.network.counted("PUT") as u64;
    assert_eq!(sent, done.tiles + done.blobs + 2);
    assert_eq!(done.tiles + 3, tiles(done.entries).count() as u64);
    assert!(checkpoint.exists());
}

#[test]
fn another_log_is_not_overwritten() {
    let Some(s3) = S3::start() else { return };
    let folder = s3.root("a/log");
    fs::create_dir_all(&folder).unwrap();
    fs::write(folder.join("checkpoint"), "of another log\n").unwrap();
    let refused = published(&mut opened(&s3, 120)).unwrap_err();
    assert!(matches!(refused, ExportError::Other { .. }), "{refused}");
    assert!(
        refused.to_string().contains(&s3.address("a/log")),
        "{refused}"
    );
    assert!(!folder.join("tile").exists());
}

#[test]
fn a_damaged_blob_is_not_published() {
    let Some(s3) = S3::start() else { return };
    let copy = tempfile::tempdir().unwrap();
    mirror(
        &Publication::open(&real(), None).unwrap(),
        copy.path(),
        None,
        None,
    )
    .unwrap();
    let view = Publication::open(copy.path(), None).unwrap();
    let blob = *view.public_blobs().next().unwrap();
    let path = Blobs::at(copy.path()).path(&blob);
    let mut bytes = fs::read(&path).unwrap();
    bytes[0] ^= 1;
    fs::write(&path, bytes).unwrap();
    let done = export_to(&view, &mut opened(&s3, 120)).unwrap();
    let damaged: Vec<_> = done.damaged.iter().map(|blob| &blob.place).collect();
    assert_eq!(damaged, [path.to_str().unwrap()]);
    let there = s3.root("a/log").join("blobs/sha256").join(blob.to_string());
    assert!(!there.exists());
    // Everything else is.
    assert_eq!(done.blobs, view.public_blobs().count() as u64 - 1);
    assert!(s3.root("a/log").join("checkpoint").exists());
}
