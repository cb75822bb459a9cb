//! Whether a served log is signed with its present key. A former one may be stolen, and a copy must keep nothing that a thief has signed
//! with it: the true log would then contradict the copy for ever.
//!
//! The operator has signed which entry gave the log the signer's key. So no more than that entry is read before anything is stored.

use crate::published::mirror_error::MirrorError;
use crate::published::reader::PublishedLog;
use zk0_protocol::entries::entry::{Body, Entry};
use zk0_protocol::log_keys::LogKeys;

/// Compares the signer of `log` with the keys of a copy, before the trees are compared. `is_held` states that the copy has the shown tree.
pub(crate) fn check(
    log: &PublishedLog<'_>,
    keys: &LogKeys,
    is_held: bool,
) -> Result<(), MirrorError> {
    let size = log.checkpoint().size;
    let is_former = if is_held {
        log.signer() != keys.at(size)
    } else {
        keys.is_former(log.signer())
    };
    refuse_if(is_former, log)
}

/// Checks that the log has the entry that gave it the signer's key, if that is not one of the first `held`, which the copy has.
pub(crate) fn check_given(log: &PublishedLog<'_>, held: u64) -> Result<(), MirrorError> {
    let since = log.signer_since();
    if since == 0 || since < held {
        return Ok(());
    }
    let given = Entry::decode(&log.entry(since)?)?.body;
    let is_given = matches!(
        given,
        Body::LogKeyRotated { rotation, .. } if rotation.statement.with.0 == *log.signer()
    );
    refuse_if(!is_given, log)
}

/// Checks the key that the log has after its first `size` entries, which gave it `keys`, before they are stored.
pub(crate) fn check_after(
    log: &PublishedLog<'_>,
    keys: &LogKeys,
    size: u64,
) -> Result<(), MirrorError> {
    refuse_if(
        size > log.signer_since() && keys.present() != log.signer(),
        log,
    )
}

fn refuse_if(is_former: bool, log: &PublishedLog<'_>) -> Result<(), MirrorError> {
    let size = log.checkpoint().size;
    if is_former {
        Err(MirrorError::FormerKey { size })
    } else {
        Ok(())
    }
}
