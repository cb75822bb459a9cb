//! An aggregator that prunes a bucket.

use super::*;
use crate::pruning::{close, proof, rounds, update, CONFIG, UNNAMED};

/// How a request begins that removes objects.
const DELETE: &str = "POST /blobs?delete";

#[tokio::test(flavor = "multi_thread")]
async fn old_updates_leave_the_bucket_and_a_bucket_that_fails_stops_no_round() {
    let Some(s3) = S3::start() else { return };
    let dir = tempfile::tempdir().unwrap();
    let operator = rounds(dir.path(), genesis(), 3);
    let mut network = Network::of_operator(dir, operator, CONFIG);
    network.keep_rounds = Some(2);
    let (address, variables) = (s3.address("net"), s3.variables());
    network.keep_blobs(move |dir| {
        let retry = RetryPeriod(Duration::from_secs(1));
        let bucket = Bucket::open(&address, &variables, retry).unwrap();
        Blobs::in_store(dir, Box::new(bucket)).unwrap()
    });
    network.start_again().await;
    let held = |bytes: &[u8]| s3.file("net", blob_digest(bytes)).exists();
    assert!((0..3).all(|round| held(&update(round))));

    s3.network.fail_next(DELETE, Fault::Unavailable, 10_000);
    close(&network).await;
    let asked = async || s3.network.counted(DELETE) > 0;
    until_async("the bucket is asked", asked).await;
    close(&network).await;
    assert!(held(&update(0)));
    s3.network.mend();
    close(&network).await;
    let gone = async || (0..3).all(|round| !held(&update(round)));
    until_async("the updates go", gone).await;
    assert!(held(&proof(0)) && held(&weights(200)) && held(UNNAMED));
    // Neither is a deleted update in the folder.
    let blobs = Blobs::at(network.dir.path());
    assert!(!blobs.is_here(&blob_digest(&update(0))));
}
