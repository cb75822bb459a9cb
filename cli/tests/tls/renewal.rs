//! A certificate that is renewed while the aggregator runs.

use super::encrypted::{Certificates, Encrypted};
use std::fs;
use std::time::Duration;
use tokio::time::sleep;
use zk0_service::tls::local_authority::{CERTIFICATE, KEY};
use zk0_testkit::until_async;

const EVERY: Duration = Duration::from_millis(5);

/// Several looks at the files.
async fn looked() {
    sleep(10 * EVERY).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_new_certificate_is_shown_and_a_broken_one_is_not() {
    let (certificates, renewed) = (Certificates::new(), Certificates::new());
    let loaded = certificates.load();
    let served = Encrypted::serve(Some(loaded.clone())).await;
    let watching = tokio::spawn(loaded.watch(EVERY));
    let mut before = served.connect("https", certificates.ca()).await.unwrap();

    // The files change one after the other. Until they belong together, the old certificate stays.
    let replace = |name: &str| {
        fs::copy(renewed.path(name), certificates.path(name)).unwrap();
    };
    replace(CERTIFICATE);
    looked().await;
    served.connect("https", certificates.ca()).await.unwrap();
    replace(KEY);
    let shown = async || served.connect("https", renewed.ca()).await.is_ok();
    until_async("the new certificate is shown", shown).await;
    let message = served.refused("https", certificates.ca()).await;
    assert!(message.contains("not signed by"), "{message}");

    fs::write(certificates.path(CERTIFICATE), "no certificate").unwrap();
    looked().await;
    served.connect("https", renewed.ca()).await.unwrap();
    fs::remove_file(certificates.path(CERTIFICATE)).unwrap();
    looked().await;
    served.connect("https", renewed.ca()).await.unwrap();

    // Connections that were open go on.
    before.governance().await.unwrap();
    assert!(!watching.is_finished());
    watching.abort();
}
