//! Asks the witnesses that a proposal names, before it is sent.

use anyhow::{Error, Result};
use tokio::task::spawn_blocking;
use zk0_aggregator::publish::new_witnesses::know;
use zk0_node::client::NodeClient;
use zk0_protocol::Rules;

/// Warns if the witnesses of these rules are not enough to publish anything. Those in force are not asked.
pub async fn check(node: &mut NodeClient, rules: &Rules) -> Result<()> {
    let policy = rules.witnesses().map_err(Error::msg)?;
    let in_force = node.governance().await?.rules.witness_policy;
    if !policy.wants_witnesses() || rules.witness_policy == in_force {
        return Ok(());
    }
    let (_, checkpoint) = node.signed_checkpoint().await?;
    let known = spawn_blocking(move || know(policy, checkpoint.as_bytes())).await?;
    if let Err(why) = known {
        tracing::warn!(
            "if this proposal passes, nothing is published until its witness policy is met: {why}"
        );
    }
    Ok(())
}
