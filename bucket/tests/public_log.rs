//! A log that is published in a bucket, and read from there by anybody over HTTP.

mod s3;

use s3::failing_network::Fault;
use s3::S3;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;
use zk0_bucket::public_log::PublicLog;
use zk0_bucket::waiting::Patience;
use zk0_ledger::published::export::{export_to, ExportError, Exported};
use zk0_ledger::published::mirror::mirror;
use zk0_ledger::published::publication::Publication;
use zk0_ledger::published::source::{Folder, Source};
use zk0_ledger::published::web::Web;
use zk0_ledger::{replay, Blobs};
use zk0_protocol::tlog::layout::tiles;

/// A ledger with a real proof.
fn real() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/fixtures/ledger")
}

fn opened(s3: &S3, seconds: u64) -> PublicLog {
    let patience = Patience(Duration::from_secs(seconds));
    PublicLog::open(&s3.address("a/log"), &s3.variables(), patience).unwrap()
}

fn published(place: &mut PublicLog) -> Result<Exported, ExportError> {
    export_to(&Publication::open(&real(), None).unwrap(), place)
}

/// Makes a ledger of what `source` publishes, and checks that it is the same.
fn is_mirrored(source: &dyn Source) {
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
    let address = format!("file://{}", folder.path().join("log").display());
    let patience = Patience(Duration::from_secs(1));
    published(&mut PublicLog::open(&address, &[], patience).unwrap()).unwrap();
    is_mirrored(&Folder::at(&folder.path().join("log")));
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
