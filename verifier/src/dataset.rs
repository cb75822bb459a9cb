//! The list of leaves behind a dataset commitment.

use zk0_circuits::claim::dataset::check_leaves;
use zk0_circuits::{DatasetCommitment, Digest};
use zk0_protocol::Refusal;

/// Checks a list of leaf hashes, 32 bytes each: there are as many as `dataset` counts, they hash to its root, and no two are the
/// same.
pub fn check_leaf_list(dataset: &DatasetCommitment, list: &[u8]) -> Result<(), Refusal> {
    let (leaves, rest) = list.as_chunks::<32>();
    if !rest.is_empty() {
        return Err(Refusal::Dataset(format!(
            "the list of leaves ends with {} extra bytes: each leaf has 32",
            rest.len()
        )));
    }
    let leaves: Vec<_> = leaves.iter().copied().map(Digest).collect();
    check_leaves(dataset, &leaves).map_err(|error| Refusal::Dataset(error.to_string()))
}
