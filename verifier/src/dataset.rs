//! The list of drawn frames behind a dataset commitment.

use zk0_circuits::claim::dataset::check_leaves;
use zk0_protocol::entries::signed::DatasetRegistration;
use zk0_protocol::evaluation_set::distinct;
use zk0_protocol::{Refusal, RefusalCode};

/// Checks a registration's list: the hash of the episodes draws its frames, and its distinct leaves have the dataset's count and
/// root.
pub fn check_leaf_list(registration: &DatasetRegistration, list: &[u8]) -> Result<(), Refusal> {
    let list = registration
        .read_list(list)
        .map_err(|error| RefusalCode::Dataset.because(error))?;
    check_leaves(&registration.dataset, &distinct(&list))
        .map_err(|error| RefusalCode::Dataset.because(error))
}
