//! What is done once for a request: its claim is compared with the ledger before its proof is verified, and it has the aggregator twice.

use super::{read, tracked_files};

/// The files of this folder that call something, with how often they do.
fn calls(folder: &str, call: &str) -> Vec<(String, usize)> {
    let files = tracked_files().into_iter();
    let sources = files.filter(|path| path.starts_with(folder) && path.ends_with(".rs"));
    let counted = sources.map(|path| {
        let count = read(&path).matches(call).count();
        (path, count)
    });
    counted.filter(|(_, count)| *count > 0).collect()
}

/// The ledger's rules compare it once more when it is recorded.
#[test]
fn the_claim_of_a_submission_is_compared_before_its_verification_and_not_again() {
    let contribution = "verifier/src/contribution.rs".to_owned();
    let begins = "aggregator/src/round/intake/submission.rs".to_owned();
    assert!(calls("aggregator/src/", "check_claim(").is_empty());
    assert_eq!(calls("aggregator/src/", "CheckedClaim::of("), [(begins, 1)]);
    let compared = [(contribution.clone(), 1)];
    assert_eq!(calls("verifier/src/", "check_claim("), compared);
    // Of what an entry has recorded, by whoever verifies it again.
    let again = [(contribution, 2)];
    assert_eq!(calls("verifier/src/", "CheckedClaim::of("), again);
}

#[test]
fn a_request_has_the_aggregator_to_be_compared_and_to_be_recorded() {
    let way = "aggregator/src/serve/in_turn.rs";
    assert_eq!(calls(way, "self.with("), [(way.to_owned(), 2)]);
    assert!(calls("aggregator/src/serve/submitting.rs", "self.with(").is_empty());
}
