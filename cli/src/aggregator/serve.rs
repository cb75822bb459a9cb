//! `zk0 aggregator serve`: runs the rounds of a network.

use super::hub_uploads::HubUploadOptions;
use super::log_store::{LogStoreOptions, OtherHistory};
use super::network_edge::NetworkEdge;
use super::policy_folders::PolicyFolderOptions;
use super::witness_check::{contradiction, WitnessCheckOptions};
use crate::blob_store::BlobStoreOptions;
use crate::certificate::{keep_current, scheme};
use crate::keys;
use crate::metrics::{serve_metrics, MetricsOptions};
use crate::otlp::OtlpOptions;
use crate::serve::{interrupted, listening_early, listening_if, online_until, ENDING};
use anyhow::{bail, Context, Result};
use std::future;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::sync::oneshot;
use tokio::task::{spawn_blocking, JoinHandle};
use tokio::time::timeout;
use zk0_aggregator::connections::starting::StartingServer;
use zk0_aggregator::observe::troubles::Troubles;
use zk0_aggregator::publish::beacon::BeaconServers;
use zk0_aggregator::publish::chosen_witnesses::chosen_witnesses;
use zk0_aggregator::publish::cosigning::{ConsistencyProver, Witnesses};
use zk0_aggregator::publish::http;
use zk0_aggregator::publish::log_server::LogServer;
use zk0_aggregator::round::request_error::RequestError;
use zk0_aggregator::serve::service::ServeError;
use zk0_aggregator::start_progress::StartProgress;
use zk0_aggregator::{Aggregator, Config, Service, SystemClock};
use zk0_service::tls::authorities::Authorities;
use zk0_service::tls::server_certificate::ServerCertificate;

/// `zk0 aggregator serve`.
#[derive(Debug, clap::Args)]
pub struct AggregatorServeOptions {
    /// The ledger's folder. With --blob-store, an empty one is filled from the store, and one that is behind is brought up to date.
    dir: PathBuf,
    /// The file of the log's signing key.
    #[arg(long)]
    key: PathBuf,
    /// Listen on this address; port 0 takes a free port. Traffic is encrypted only with --tls-certificate.
    #[arg(long, default_value = "127.0.0.1:7071")]
    listen: SocketAddr,
    /// Open rounds until the network has had this many in all, since its founding; then no more [default: no limit]
    #[arg(long, default_value_t = u64::MAX, hide_default_value = true)]
    rounds: u64,
    /// Open a round only when this many nodes have committed to a dataset. With 0, rounds open and close although nobody takes part.
    #[arg(long, default_value_t = 1)]
    min_nodes: usize,
    /// When a round has closed, delete the updates of rounds that are older than the last N closed ones, as `zk0 ledger prune` does. You
    /// sign that with --key, so that auditors can tell them from lost ones [default: the updates of all rounds are kept]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    keep_rounds: Option<u64>,
    /// Publish nothing before the witnesses that this file names have cosigned it (a C2SP tlog-policy with the witnesses' addresses).
    /// The ledger's folder remembers the file's content. Leave this out if the network's rules name the witnesses.
    #[arg(long, value_name = "FILE")]
    witness_policy: Option<PathBuf>,
    /// Believe only witnesses whose certificates are signed by one in this PEM file. All witnesses then need an address with https://
    /// [default: the authorities that the system trusts]
    #[arg(long, value_name = "FILE")]
    witness_ca: Option<PathBuf>,
    /// Wait this many seconds for a witness to answer.
    #[arg(long, value_name = "SECONDS", default_value_t = 5, value_parser = clap::value_parser!(u64).range(1..=3600))]
    witness_seconds: u64,
    #[command(flatten)]
    witness_check: WitnessCheckOptions,
    /// Fetch drand's beacons from the server at this address, if the rules name a beacon. Repeat the option for more servers; the next one
    /// is asked where one fails [default: the public servers of drand's "quicknet"]
    #[arg(long = "beacon", value_name = "URL")]
    beacons: Vec<String>,
    /// Wait this many seconds for a server of beacons to answer.
    #[arg(long, value_name = "SECONDS", default_value_t = 10, value_parser = clap::value_parser!(u64).range(1..=3600))]
    beacon_seconds: u64,
    /// Also serve the log's files over HTTP, on this address (C2SP tlog-tiles). With --tls-certificate it is HTTPS.
    #[arg(long, value_name = "ADDRESS")]
    log_listen: Option<SocketAddr>,
    #[command(flatten)]
    store: BlobStoreOptions,
    /// With --blob-store: keep at most this many bytes of blobs in the ledger's folder, besides what the open round and the next one need.
    /// The others are read from the store when somebody asks for them [default: no limit]
    #[arg(long, value_name = "BYTES", requires = "blob_store")]
    blob_cache_bytes: Option<u64>,
    /// With --blob-store s3://, gs:// or az://: let nodes put their updates straight into the bucket. A node gets an address that the bucket has
    /// signed for it, and the aggregator reads and verifies what is there. The bucket has to be within the nodes' reach. A node that cannot use
    /// its address sends the update to the aggregator.
    #[arg(long, requires = "blob_store")]
    presigned_uploads: bool,
    /// With --presigned-uploads: an address is valid for this many seconds. What has begun then may end later.
    #[arg(
        long,
        value_name = "SECONDS",
        default_value_t = 300,
        requires = "presigned_uploads",
        value_parser = clap::value_parser!(u64).range(1..=3600)
    )]
    presigned_seconds: u64,
    #[command(flatten)]
    log_store: LogStoreOptions,
    #[command(flatten)]
    metrics: MetricsOptions,
    #[command(flatten)]
    pub otlp: OtlpOptions,
    #[command(flatten)]
    folders: PolicyFolderOptions,
    #[command(flatten)]
    uploads: HubUploadOptions,
    #[command(flatten)]
    edge: NetworkEdge,
}

/// Time at the end for the last policy folder and the log's store. The next start completes the store.
const LAST_FILES: Duration = Duration::from_secs(10);

/// Names of background tasks.
const METRICS: &str = "the server of the metrics";
const LOG_STORE: &str = "the writing of the log to its store";
const FOLDERS: &str = "the writing of policy folders";
const UPLOADS: &str = "the publication of policy folders on the Hub";

/// Runs the command.
pub fn serve(options: &AggregatorServeOptions) -> Result<()> {
    let config = Config {
        rounds: Some(options.rounds).filter(|rounds| *rounds != u64::MAX),
        min_nodes: options.min_nodes,
    };
    let key = keys::read(&options.key)?;
    let certificate = options.edge.certificate()?;
    let (limits, log_limits) = options.edge.limits(options.log_listen.is_some());
    let (listener, address) = listening_early(options.listen)?;
    let metrics = options.metrics.metrics.map(listening_early).transpose()?;
    let progress = StartProgress::default();
    let starting = StartingServer::begin(
        &listener,
        metrics.as_ref().map(|(listener, _)| listener),
        certificate.as_ref(),
        limits.connections,
        progress.clone(),
    )?;
    let blobs = options.store.blobs(&options.dir)?;
    if options.presigned_uploads && !blobs.takes_sent() {
        let address = blobs.store_address().unwrap_or_default();
        bail!(
            "--presigned-uploads needs a bucket that signs addresses (s3://, gs:// or az://), and --blob-store {address} is a folder: leave --presigned-uploads out, or use a bucket"
        );
    }
    tracing::info!(
        "the aggregator starts: until the ledger is verified, {address} answers how far that is"
    );
    let aggregator = Aggregator::open_noting(
        &options.dir,
        None,
        key,
        Arc::new(SystemClock),
        config,
        blobs.clone(),
        progress.clone(),
    );
    let aggregator = aggregator.map_err(with_exit_code)?;
    let held = aggregator.ledger().size();
    let rules = aggregator.state().rules();
    let policy = chosen_witnesses(&options.dir, rules, options.witness_policy.as_deref())?;
    options.witness_check.check(held, &policy)?;
    let folders = options.folders.open(&aggregator, options.rounds)?;
    let log_store = options
        .log_store
        .open(&options.dir, &blobs, &options.store)?;
    if let Some(log_store) = &log_store {
        log_store.check(aggregator.ledger())?;
    }
    let uploads = options.uploads.open(options.folders.out())?;
    online_until(ENDING, async {
        let mut stop = Box::pin(interrupted());
        // All addresses are bound before the log names one.
        let log_listener = listening_if(options.log_listen)?;
        let network = *aggregator.state().network();
        let checkpoint = aggregator.ledger().checkpoint().to_vec();
        let reader = aggregator.ledger().reader().clone();
        let prove: ConsistencyProver = Arc::new(move |old, new| {
            let proof = reader.consistency_between(old, new);
            proof.map_err(|error| error.to_string())
        });
        let patience = Duration::from_secs(options.beacon_seconds);
        let beacons = if options.beacons.is_empty() {
            BeaconServers::public(patience)
        } else {
            BeaconServers::new(options.beacons.clone(), patience)
        };
        let mut service = Service::with_limits(aggregator, limits).with_beacons(beacons);
        if let Some(bytes) = options.blob_cache_bytes {
            service = service.with_blob_cache(bytes);
        }
        if let Some(rounds) = options.keep_rounds {
            service = service.with_kept_rounds(rounds);
        }
        if options.presigned_uploads {
            let valid = Duration::from_secs(options.presigned_seconds);
            service = service.with_presigned_uploads(valid);
        }
        if let Some(certificate) = &certificate {
            service = service.encrypted(certificate.clone());
        }
        keep_current(certificate.as_ref(), "aggregator", address);
        let mut watched = None;
        if policy.wants_witnesses() {
            let patience = Duration::from_secs(options.witness_seconds);
            let authorities =
                Authorities::of_system("--witness-ca").in_file(options.witness_ca.clone());
            let is_new = service.is_new_policy(policy.clone()).await?;
            let witnesses = Witnesses::believing(policy, patience, &authorities)?;
            let witnesses = Arc::new(options.witness_check.compared(witnesses)?);
            // If the witnesses of a new policy never answer, a vote has to be able to replace them.
            if !is_new {
                progress.waits_for_witness();
                tokio::select! {
                    () = &mut stop => return Ok(()),
                    checked = options.witness_check.not_behind(&witnesses, checkpoint, prove) => checked?,
                }
                watched = Some(witnesses.clone());
            }
            service = service.witnessed(witnesses).await?;
        }
        // The service answers those who come from now on.
        spawn_blocking(move || drop(starting)).await?;
        let listener = TcpListener::from_std(listener)?;
        let metrics_listener = match metrics {
            Some((listener, address)) => Some((TcpListener::from_std(listener)?, address)),
            None => None,
        };
        tracing::info!(listening = %address, "the aggregator of network {network} listens on {address}");
        let troubles = service.troubles().clone();
        let log = log_listener.map(|listener| {
            let server = LogServer::new(&options.dir).with_blobs(blobs);
            serve_log(listener, server, certificate, log_limits, &troubles)
        });
        let metrics = metrics_listener.map(|listener| {
            let serving = serve_metrics(listener, service.clone());
            tokio::spawn(troubles.clone().supervised(METRICS, serving))
        });
        let (log_ended, log_stopped) = oneshot::channel();
        let log_store = log_store.map(|store| {
            let writing = store.follow(service.clone(), log_stopped);
            tokio::spawn(troubles.clone().supervised(LOG_STORE, writing))
        });
        let (ended, stopped) = oneshot::channel();
        let folders = folders.map(|folders| {
            let writing = folders.follow(service.clone(), stopped);
            tokio::spawn(troubles.clone().supervised(FOLDERS, writing))
        });
        let uploads = uploads.map(|uploads| {
            let publishing = uploads.follow(service.clone());
            tokio::spawn(troubles.clone().supervised(UPLOADS, publishing))
        });
        let contradicted = contradiction(watched, service.clone(), held);
        let served = tokio::select! {
            served = service.serve(listener, stop) => served,
            error = contradicted => return Err(error),
        };
        drop((ended, log_ended));
        let last_files = async {
            if let Some(folders) = folders {
                folders.await?;
            }
            if let Some(log_store) = log_store {
                log_store.await?;
            }
            anyhow::Ok(())
        };
        match timeout(LAST_FILES, last_files).await {
            Ok(written) => written?,
            Err(_) => tracing::warn!(
                "the last files are not written: it took too long to end. The store of the log lacks the newest entries, or a policy folder is missing"
            ),
        }
        for server in [log, metrics, uploads].into_iter().flatten() {
            server.abort();
        }
        let served = served.map_err(|error| match error {
            ServeError::Round(error @ RequestError::StoredEntries(_)) => with_exit_code(error),
            other => other.into(),
        });
        served.context("the aggregator")
    })
}

/// The error, with what decides on the exit code.
fn with_exit_code(error: RequestError) -> anyhow::Error {
    match error {
        RequestError::StoredEntries(why) => {
            anyhow::Error::new(*why).context(OtherHistory::in_store())
        }
        other => other.into(),
    }
}

fn serve_log(
    (listener, address): (TcpListener, SocketAddr),
    server: LogServer,
    certificate: Option<Arc<ServerCertificate>>,
    limits: http::HttpLimits,
    troubles: &Troubles,
) -> JoinHandle<()> {
    let router = server.router(limits);
    let scheme = scheme(certificate.as_ref());
    tracing::info!("the log is served on {scheme}://{address}");
    let serving = async move {
        let forever = future::pending();
        http::serve_with(listener, router, limits, certificate.as_ref(), forever).await;
    };
    tokio::spawn(
        troubles
            .clone()
            .supervised("the server of the log", serving),
    )
}
