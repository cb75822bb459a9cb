//! A store names the network that it belongs to. The first name stays.

use std::fs;
use std::path::Path;
use std::time::Duration;
use zk0_circuits::Digest;
use zk0_ledger::blobs::store::BlobStore;
use zk0_ledger::bucket::waiting::RetryPeriod;
use zk0_ledger::bucket::Bucket;
use zk0_testkit::s3::S3;

fn the_first_name_stays(address: &str, variables: &[(String, String)], root: &Path) {
    let patience = RetryPeriod(Duration::from_secs(120));
    let open = || Bucket::open(address, variables, patience).unwrap();
    let [first, second] = [[1; 32], [2; 32]].map(Digest);
    let (ours, theirs) = (open(), open());
    assert_eq!(ours.network().unwrap(), None);
    assert_eq!(theirs.network().unwrap(), None);
    assert_eq!(ours.name_network(&first).unwrap(), first);
    // This one asked when there was no name yet.
    assert_eq!(theirs.name_network(&second).unwrap(), first);
    assert_eq!(ours.name_network(&first).unwrap(), first);
    assert_eq!(open().network().unwrap(), Some(first));
    let named = root.join("network");
    assert_eq!(fs::read_to_string(&named).unwrap(), format!("{first}\n"));
    // It is no blob.
    assert_eq!(open().all().unwrap(), []);
    for wrong in [&b""[..], b"another\xff", &[b'7'; 1000]] {
        fs::write(&named, wrong).unwrap();
        let refused = ours.network().unwrap_err();
        assert_eq!(theirs.name_network(&first).unwrap_err(), refused);
        let reported = refused.to_string();
        assert!(
            reported.contains("does not hold the id of a network"),
            "{reported}"
        );
    }
}

#[test]
fn the_first_name_of_a_folder_stays() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("a/net");
    let address = format!("file://{}", root.display());
    the_first_name_stays(&address, &[], &root);
}

#[test]
fn the_first_name_of_a_bucket_stays() {
    for bucket in [S3::start(), S3::start_as_google()].into_iter().flatten() {
        let (address, variables) = (bucket.address("a/net"), bucket.variables());
        the_first_name_stays(&address, &variables, &bucket.root("a/net"));
    }
}
