//! A blob with a proof has two parts where its claim names a weight check, and one where it does not.

use zk0_circuits::{Claim, Digest};
use zk0_protocol::entries::proof_blob::ProofBlob;
use zk0_testkit::network::{self, Chain};

/// A claim that names a weight check, or none.
fn claim(weight_check: Option<Digest>) -> Claim {
    Claim {
        weight_check,
        ..network::claim(&Chain::all_committed(1).state, 0)
    }
}

#[test]
fn what_is_joined_is_split_again() {
    let named = claim(Some(Digest([1; 32])));
    let parts = ProofBlob {
        weight_check: b"of the weights",
        sp1: b"proof",
    };
    assert_eq!(ProofBlob::split(&named, &parts.join()), Ok(parts));
    let parts = ProofBlob {
        weight_check: b"",
        sp1: b"proof",
    };
    assert_eq!(ProofBlob::split(&claim(None), &parts.join()), Ok(parts));
}

#[test]
fn a_blob_that_is_shorter_than_it_says_is_refused() {
    let named = claim(Some(Digest([1; 32])));
    for blob in [&b""[..], &[1, 0, 0], &[1, 0, 0, 0], &[255; 100]] {
        let refused = ProofBlob::split(&named, blob).unwrap_err().to_string();
        assert!(refused.contains(&format!("it has {} bytes", blob.len())));
    }
}
