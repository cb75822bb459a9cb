//! The key of a node, and its identity.

use crate::harness::{fails, prints, text};

#[test]
fn an_existing_key_is_kept_and_its_identity_can_be_printed() {
    let scratch = tempfile::tempdir().unwrap();
    let key = scratch.path().join("node.key");
    let key = text(&key);
    let made = prints(&["node", "keygen", key]);
    let refused = fails(&["node", "keygen", key]);
    let hint = format!("zk0 node identity {key}");
    assert!(refused.contains(&hint), "{refused}");
    assert_eq!(prints(&["node", "identity", key]), made);
}
