//! `zk0 aggregator enrol`, `suspend` and `reinstate`: the operator decides which nodes take part.

use crate::keys;
use crate::network::NetworkChoice;
use crate::output::println;
use crate::serve::online;
use anyhow::{bail, Context, Result};
use ed25519_dalek::SigningKey;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use zk0_aggregator::round::founding;
use zk0_aggregator::{Clock, SystemClock};
use zk0_circuits::NodeId;
use zk0_ledger::{Ledger, LedgerError};
use zk0_protocol::entries::member::NodeEnrolled;

/// `zk0 aggregator enrol`.
#[derive(Debug, clap::Args)]
pub struct Enrol {
    /// The ledger's folder, if the aggregator is not running.
    #[arg(
        conflicts_with = "NetworkChoice",
        required_unless_present = "NetworkChoice"
    )]
    dir: Option<PathBuf>,
    #[command(flatten)]
    network: Option<NetworkChoice>,
    /// The file of the log's signing key.
    #[arg(long)]
    key: PathBuf,
    /// NAME=IDENTITY. `zk0 node keygen` prints the identity; the name is for people.
    #[arg(long = "node", value_name = "NAME=IDENTITY", required = true)]
    nodes: Vec<NodeToEnrol>,
}

/// `zk0 aggregator suspend` and `zk0 aggregator reinstate`.
#[derive(Debug, clap::Args)]
pub struct OperatorDecides {
    #[command(flatten)]
    network: NetworkChoice,
    /// The file of the operator's key: the key that founded the network.
    #[arg(long)]
    key: PathBuf,
    /// Its identity (`zk0 audit show --node X`).
    node: NodeId,
}

/// Suspends a node, or ends its suspension.
pub fn decide(options: &OperatorDecides, suspended: bool) -> Result<()> {
    let (key, node) = (keys::read(&options.key)?, options.node);
    let entry = online(async {
        let mut aggregator = options.network.connect_for_command(key).await?;
        Ok(aggregator.decide_standing(node, suspended).await?)
    })?;
    let done = if suspended { "suspended" } else { "reinstated" };
    println!("entry {entry}: node {node} is {done}");
    Ok(())
}

/// Runs the command.
pub fn enrol(options: &Enrol) -> Result<()> {
    let key = keys::read(&options.key)?;
    match (&options.dir, &options.network) {
        (Some(dir), _) => in_folder(dir, key, &options.nodes),
        (None, Some(network)) => online(through(network, key, &options.nodes)),
        (None, None) => bail!("name the ledger's folder, or the aggregator with --aggregator"),
    }
}

fn in_folder(dir: &Path, key: SigningKey, nodes: &[NodeToEnrol]) -> Result<()> {
    let mut ledger = match Ledger::open(dir, None, key) {
        Err(LedgerError::Locked(_)) => bail!(
            "the ledger in {} is in use, most likely by its running aggregator: enrol through that, with --aggregator ADDRESS --network ID in \
             place of the folder",
            dir.display()
        ),
        opened => opened?,
    };
    ledger.watch_clock(SystemClock.now_ms(), || SystemClock.steady())?;
    let nodes = nodes.iter().map(Into::into).collect();
    Ok(founding::enrol(&mut ledger, nodes, &SystemClock)?)
}

async fn through(network: &NetworkChoice, key: SigningKey, nodes: &[NodeToEnrol]) -> Result<()> {
    let mut aggregator = network.connect_for_command(key).await?;
    for NodeToEnrol { name, node } in nodes {
        let entry = aggregator
            .enrol(*node, name.clone())
            .await
            .with_context(|| format!("enrolling {name} ({node})"))?;
        tracing::info!("enrolled {name} ({node}) in entry {entry}");
    }
    Ok(())
}

/// A node to enrol, `NAME=IDENTITY`.
#[derive(Clone, Debug)]
pub struct NodeToEnrol {
    /// A name for people.
    pub name: String,
    /// The public half of its key.
    pub node: NodeId,
}

impl FromStr for NodeToEnrol {
    type Err = anyhow::Error;

    fn from_str(text: &str) -> Result<Self> {
        let Some((name, node)) = text.split_once('=') else {
            bail!("'{text}' is not of the form NAME=IDENTITY");
        };
        Ok(Self {
            name: name.into(),
            node: node.parse()?,
        })
    }
}

impl From<&NodeToEnrol> for NodeEnrolled {
    fn from(NodeToEnrol { name, node }: &NodeToEnrol) -> Self {
        Self {
            node: *node,
            name: name.clone(),
        }
    }
}
