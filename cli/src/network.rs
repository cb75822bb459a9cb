//! The options that name a network, and who connects to it.

use crate::dataset::{refuse_left_out, CameraNames, RecordingName};
use crate::keys;
use crate::policy::CacheOptions;
use anyhow::{Context, Result};
use ed25519_dalek::SigningKey;
use std::fs::{self, DirBuilder};
use std::io;
use std::os::unix::fs::{DirBuilderExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::time::Duration;
use zk0_circuits::Digest;
use zk0_lerobot::dataset::Dataset;
use zk0_node::client::NodeClient;
use zk0_node::participant::Participant;
use zk0_node::state_files::lock::StateLock;
use zk0_node::state_files::version;
use zk0_service::tls::service_address::ServiceAddress;

/// How long a typed command waits. Then its user decides.
const COMMAND_PATIENCE: Duration = Duration::from_secs(10);

/// The network that is meant.
#[derive(Debug, clap::Args)]
pub struct NetworkChoice {
    /// The aggregator's address, such as https://aggregator.example:7071. With http:// nothing is encrypted.
    #[arg(long, value_name = "ADDRESS")]
    aggregator: String,
    /// Believe only an aggregator whose certificate is signed by one in this PEM file [default: the authorities that the system trusts]
    #[arg(long, value_name = "FILE")]
    ca: Option<PathBuf>,
    /// The network's id, as its operator published it. No other network is accepted.
    #[arg(long, value_name = "ID")]
    network: Digest,
}

/// The network that is meant, and who signs.
#[derive(Debug, clap::Args)]
pub struct Signer {
    #[command(flatten)]
    network: NetworkChoice,
    /// The file of the key that signs: a node's, made by `zk0 node keygen`, or a governor's, made by `zk0 governance keygen`.
    #[arg(long, value_name = "FILE")]
    key: PathBuf,
}

/// The network that a node takes part in, and with what.
#[derive(Debug, clap::Args)]
pub struct Membership {
    #[command(flatten)]
    signer: Signer,
    /// The recording: a LeRobotDataset folder, or hub:owner/name[@revision] on the Hugging Face Hub.
    #[arg(long, value_name = "RECORDING")]
    dataset: RecordingName,
    /// Refuse a recording with episodes that have fewer pictures than rows. Without this option, these episodes are left out: the node
    /// neither trains on them nor registers them.
    #[arg(long)]
    whole_recordings: bool,
    #[command(flatten)]
    cameras: CameraNames,
    /// Keep the policy, the node's secret, the evaluation set, updates, training histories and receipts in this folder. Keep the folder secret.
    #[arg(long, value_name = "DIR")]
    state: PathBuf,
    /// Take part in this many rounds. With 0, the node only commits to the recording, and ends.
    #[arg(long, default_value_t = 1)]
    pub rounds: u64,
    /// Have updates evaluated on this many samples, within the bounds of the network's rules. By default, as few as the rules allow. The
    /// more samples, the surer an honest update passes, and the longer its proof takes.
    #[arg(long, value_name = "N")]
    eval_samples: Option<u32>,
    #[command(flatten)]
    cache: CacheOptions,
}

impl NetworkChoice {
    /// Connects to the network.
    pub async fn connect(&self, key: SigningKey) -> Result<NodeClient> {
        Ok(NodeClient::connect(self.address(), self.network, key).await?)
    }

    fn address(&self) -> ServiceAddress {
        ServiceAddress::from(self.aggregator.clone()).with_ca(self.ca.clone())
    }

    /// Connects for a command, which retries briefly.
    pub async fn connect_for_command(&self, key: SigningKey) -> Result<NodeClient> {
        Ok(self.connect(key).await?.giving_up_after(COMMAND_PATIENCE))
    }
}

impl Signer {
    /// Connects with the signer's key, for a command.
    pub async fn connect(&self) -> Result<NodeClient> {
        let key = keys::read(&self.key)?;
        self.network.connect_for_command(key).await
    }
}

impl Membership {
    /// The participant and its connection. Another node on the state folder is an error, and so is another version of its files.
    pub async fn begin(&self) -> Result<(Participant, NodeClient)> {
        let state = &self.state;
        make_state(state).with_context(|| format!("creating {}", state.display()))?;
        // What follows reads and removes files there.
        let lock = StateLock::take(state)?;
        version::check(state)?;
        // A node that restarts while its aggregator is away does not ask the Hub each time.
        let (network, key) = (&self.signer.network, keys::read(&self.signer.key)?);
        let node = NodeClient::connect_keeping(network.address(), network.network, key, state);
        let node = node.await?;
        let dataset = self.dataset.locate_for_node(state)?;
        if self.whole_recordings {
            refuse_left_out(&Dataset::open(&dataset)?)?;
        }
        let participant = Participant {
            dataset,
            rename_map: self.cameras.rename_map.clone(),
            state: state.clone(),
            cache: self.cache.open_in(state)?,
            eval_samples: self.eval_samples,
            variants: None,
            lock,
        };
        Ok((participant, node))
    }
}

/// Makes a node's folder, whose secret and samples are for its owner alone. Warns if others can look into an existing one.
pub fn make_state(folder: &Path) -> io::Result<()> {
    let mut builder = DirBuilder::new();
    builder.recursive(true).mode(0o700).create(folder)?;
    let mode = fs::metadata(folder)?.permissions().mode();
    if mode & 0o077 != 0 {
        let folder = folder.display();
        tracing::warn!(
            "other users of this machine can look into {folder}, which holds the secret and the samples of the recording: run `chmod 700 {folder}`"
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_folder_of_a_node_is_for_its_owner_alone() {
        let dir = tempfile::tempdir().unwrap();
        let state = dir.path().join("nodes/state");
        make_state(&state).unwrap();
        let mode = fs::metadata(&state).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o700);
        // An operator's own choice stays.
        fs::set_permissions(&state, fs::Permissions::from_mode(0o750)).unwrap();
        make_state(&state).unwrap();
        let mode = fs::metadata(&state).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o750);
    }
}
