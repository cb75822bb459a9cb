//! The time, for what the commands record.

use anyhow::{Context, Result};
use std::time::{SystemTime, UNIX_EPOCH};

/// The time in Unix milliseconds.
pub fn now_ms() -> Result<u64> {
    let now = SystemTime::now().duration_since(UNIX_EPOCH);
    let now = now.context("the clock shows a time before 1970")?;
    Ok(u64::try_from(now.as_millis())?)
}
