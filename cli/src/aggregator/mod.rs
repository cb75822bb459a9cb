//! `zk0 aggregator`: found a network, enrol nodes, run rounds.

mod init;
mod rules;

use crate::keys;
use anyhow::{bail, Context, Result};
use init::Init;
use rules::{CommonRules, LEAST_UPDATE_LIMIT};
use std::{net::SocketAddr, path::PathBuf, sync::Arc, time::Duration};
use tokio::{net::TcpListener, runtime::Runtime, task::JoinHandle};
use zk0_aggregator::{
    publish::{cosigning::Witnesses, http, log_server::LogServer},
    round::{
        aggregator::{Aggregator, Config},
        clock::{Clock, SystemClock},
    },
    serve::service::Service,
};
use zk0_circuits::NodeId;
use zk0_ledger::{folder, log::Ledger};
use zk0_protocol::entries::{entry::Body, member::NodeEnrolled};

/// What to do.
#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Make a signing key for the log.
    Keygen {
        /// Where the key goes.
        file: PathBuf,
    },
    /// Print rules as JSON: edit them, and found a network with them (`init --rules`). `max_update_bytes` is for the micro
    /// profile: `init` says what another policy needs.
    Rules(CommonRules),
    /// Found a network: its rules, its initial policy, its first nodes.
    Init(Init),
    /// Enrol a node in a network that is not being served at the moment.
    Enrol {
        /// The ledger's directory.
        dir: PathBuf,
        /// The log's signing key.
        #[arg(long)]
        key: PathBuf,
        /// NAME=IDENTITY, as `zk0 node keygen` prints it.
        #[arg(long = "node", required = true)]
        nodes: Vec<Enrolment>,
    },
    /// Serve a network: open rounds, verify contributions, aggregate.
    Serve(Serve),
}

/// `zk0 aggregator serve`.
#[derive(Debug, clap::Args)]
pub struct Serve {
    /// The ledger's directory.
    dir: PathBuf,
    /// The log's signing key.
    #[arg(long)]
    key: PathBuf,
    /// Address to listen on; port 0 takes a free one. Traffic is not encrypted: put a TLS proxy before it.
    #[arg(long, default_value = "127.0.0.1:7071")]
    listen: SocketAddr,
    /// Rounds to run before no more is opened.
    #[arg(long, default_value_t = u64::MAX, hide_default_value = true)]
    rounds: u64,
    /// Nodes that must have committed to a dataset before a round opens.
    #[arg(long, default_value_t = 1)]
    min_nodes: usize,
    /// The witnesses and the quorum without which nothing is published (a C2SP tlog-policy file, with the witnesses'
    /// addresses). The ledger's directory remembers it.
    #[arg(long)]
    policy: Option<PathBuf>,
    /// How long a witness may take to answer, in seconds.
    #[arg(long, default_value_t = 5)]
    witness_seconds: u64,
    /// Serve the log's files over HTTP too, on this address (C2SP tlog-tiles).
    #[arg(long)]
    log_listen: Option<SocketAddr>,
}

/// A node to enrol, `NAME=IDENTITY`.
#[derive(Clone, Debug)]
pub struct Enrolment {
    /// A name for people.
    pub name: String,
    /// Its key.
    pub node: NodeId,
}

impl std::str::FromStr for Enrolment {
    type Err = anyhow::Error;

    fn from_str(text: &str) -> Result<Self> {
        let Some((name, node)) = text.split_once('=') else {
            bail!("'{text}' is not NAME=IDENTITY");
        };
        Ok(Self {
            name: name.into(),
            node: node.parse()?,
        })
    }
}

/// Runs the command.
pub fn run(command: &Command) -> Result<()> {
    match command {
        Command::Keygen { file } => {
            println!("{}", keys::generate(file)?);
            Ok(())
        }
        Command::Rules(common) => {
            let rules = common.rules(LEAST_UPDATE_LIMIT)?;
            println!("{}", serde_json::to_string_pretty(&rules)?);
            Ok(())
        }
        Command::Init(options) => init::found(options),
        Command::Enrol { dir, key, nodes } => {
            let mut ledger = Ledger::open(dir, None, keys::read(key)?)?;
            ledger.watch_clock(SystemClock.now_ms(), || SystemClock.steady())?;
            enrol(&mut ledger, nodes)
        }
        Command::Serve(options) => serve(options),
    }
}

fn enrol(ledger: &mut Ledger, nodes: &[Enrolment]) -> Result<()> {
    for Enrolment { name, node } in nodes {
        let enrolled = NodeEnrolled {
            node: *node,
            name: name.clone(),
        };
        ledger
            .append(SystemClock.now_ms(), Body::NodeEnrolled(enrolled))
            .with_context(|| format!("enrolling {name}"))?;
        tracing::info!("enrolled {name} ({node})");
    }
    Ok(())
}

/// Starts serving the log's files, if that is wanted.
async fn log_files(options: &Serve) -> Result<Option<JoinHandle<()>>> {
    let Some(listen) = options.log_listen else {
        return Ok(None);
    };
    let listener = TcpListener::bind(listen)
        .await
        .with_context(|| format!("listening on {listen}"))?;
    tracing::info!("log on http://{}", listener.local_addr()?);
    let server = Arc::new(LogServer::new(&options.dir));
    let limits = http::Limits::default();
    Ok(Some(tokio::spawn(http::serve(
        listener,
        server,
        limits,
        std::future::pending(),
    ))))
}

fn serve(options: &Serve) -> Result<()> {
    let config = Config {
        rounds: Some(options.rounds).filter(|rounds| *rounds != u64::MAX),
        min_nodes: options.min_nodes,
    };
    let aggregator = Aggregator::open(
        &options.dir,
        None,
        keys::read(&options.key)?,
        Arc::new(SystemClock),
        config,
    )?;
    let ruled = aggregator.state().rules().witnesses();
    let ruled = ruled.map_err(anyhow::Error::msg)?;
    let policy = match &options.policy {
        Some(_) if ruled.wants_witnesses() => {
            bail!("this network's rules name its witnesses: leave --policy out")
        }
        None if ruled.wants_witnesses() => ruled,
        Some(path) => crate::ledger::read_witness_policy(path)?,
        None => folder::read_policy(&options.dir)?,
    };
    if !policy.wants_witnesses() && options.policy.is_some() {
        folder::write_policy(&options.dir, &policy)?;
    }
    Runtime::new()
        .context("starting the runtime")?
        .block_on(async {
            let listen = options.listen;
            let listener = TcpListener::bind(listen)
                .await
                .with_context(|| format!("listening on {listen}"))?;
            let address = listener.local_addr()?;
            let network = *aggregator.state().network();
            let mut service = Service::new(aggregator);
            if policy.wants_witnesses() {
                let witnesses =
                    Witnesses::new(policy, Duration::from_secs(options.witness_seconds))?;
                service = service.witnessed(witnesses).await?;
            }
            tracing::info!(listening = %address, "aggregator of network {network} on {address}");
            let log = log_files(options).await?;
            let served = service.serve(listener, crate::interrupted()).await;
            if let Some(log) = log {
                log.abort();
            }
            served.context("the aggregator")
        })
}
