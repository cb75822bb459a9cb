//! The list of drawn frames behind a dataset commitment.

use zk0_circuits::claim::dataset::check_leaves;
use zk0_protocol::entries::signed::DatasetRegistration;
use zk0_protocol::evaluation_set::distinct;
use zk0_protocol::{Refusal, RefusalCode};

/// Checks the list of drawn frames that a registration names: it has exactly the frames that the hash of the episodes draws, and their
/// distinct leaves are as many as the dataset counts, and hash to its root.
pub fn check_leaf_list(registration: &DatasetRegistration, list: &[u8]) -> Result<(), Refusal> {
    let list = registration
        .read_list(list)
        .map_err(|error| RefusalCode::Dataset.because(error))?;
    check_leaves(&registration.dataset, &distinct(&list))
        .map_err(|error| RefusalCode::Dataset.because(error))
}
