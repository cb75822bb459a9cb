//! An aggregator on loopback, to kill and restart.

use super::operator::Operator;
use super::{
    files, found, genesis, log_key, with_leaves, ManualClock, SigningNode, COMMIT_MS, START_MS,
};
use crate::until_async;
use ed25519_dalek::SigningKey;
use std::fs::File;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::Arc;
use std::time::Duration;
use tempfile::TempDir;
use tokio::sync::oneshot;
use tokio::task::JoinHandle;
use tonic::transport::{Channel, Endpoint};
use tonic::Status;
use zk0_aggregator::connections::listening::listen;
use zk0_aggregator::publish::beacon::BeaconServers;
use zk0_aggregator::publish::cosigning::Witnesses;
use zk0_aggregator::round::intake::statements::SentStatement;
use zk0_aggregator::round::request_error::RequestError;
use zk0_aggregator::{Aggregator, Clock, Config, Limits, Polled, Service};
use zk0_circuits::{Digest, NodeId};
use zk0_ledger::blobs::Blobs;
use zk0_ledger::Ledger;
use zk0_protocol::blob::blob_digest;
use zk0_protocol::entries::entry::{Body, Entry};
use zk0_protocol::entries::genesis::Genesis;
use zk0_protocol::request_head::{Method, RequestHead};
use zk0_protocol::rpc::federation as proto;
use zk0_protocol::rpc::federation::federation_client::FederationClient;
use zk0_protocol::rpc::head_metadata::with_head;
use zk0_protocol::tlog::checkpoint::Checkpoint;
use zk0_protocol::tlog::receipt::Receipt;
use zk0_protocol::tlog::witness_policy::WitnessPolicy;
use zk0_protocol::Signed;

/// Bytes of [`Network::long_download`].
pub const LONG_BYTES: u64 = 8 << 20;

/// A running aggregator.
pub struct Network {
    /// Its folder.
    pub dir: TempDir,
    /// Its clock.
    pub clock: Arc<ManualClock>,
    /// Its genesis.
    pub genesis: Genesis,
    /// The operator's settings, from the next start.
    pub config: Config,
    service: Option<Service>,
    limits: Limits,
    /// The policy of witnesses, from the next start.
    pub policy: Option<WitnessPolicy>,
    /// Servers of beacons.
    pub beacons: Option<BeaconServers>,
    /// Its URL.
    pub address: String,
    kept: Box<dyn Fn(&Path) -> Blobs + Send + Sync>,
    /// Bytes of blobs in the folder, from the next start.
    pub blob_cache_bytes: Option<u64>,
    /// How many closed rounds keep their updates, from the next start.
    pub keep_rounds: Option<u64>,
    /// Validity of the store's addresses, from the next start.
    pub presigned: Option<Duration>,
    /// The log's key, from the next start.
    pub log_key: SigningKey,
    running: Option<(oneshot::Sender<()>, JoinHandle<()>)>,
}

impl Network {
    /// Founds and serves a network.
    pub async fn start(nodes: &[&SigningNode], config: Config) -> Self {
        Self::start_with(nodes, config, Limits::default()).await
    }

    /// [`Self::start`] with limits.
    pub async fn start_with(nodes: &[&SigningNode], config: Config, limits: Limits) -> Self {
        Self::start_as(nodes, config, limits, genesis(), None, None).await
    }

    /// [`Self::start_with`] with genesis, witnesses and beacons.
    pub async fn start_as(
        nodes: &[&SigningNode],
        config: Config,
        limits: Limits,
        genesis: Genesis,
        policy: Option<WitnessPolicy>,
        beacons: Option<BeaconServers>,
    ) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let clock = Arc::new(ManualClock::at(START_MS));
        let mut aggregator = found(dir.path(), genesis.clone(), clock.clone(), config).unwrap();
        for (number, node) in nodes.iter().enumerate() {
            aggregator
                .enrol(node.id(), format!("node-{number}"))
                .unwrap();
        }
        let mut network = Self::stopped(dir, clock, genesis, config);
        (network.limits, network.policy, network.beacons) = (limits, policy, beacons);
        network.service = Some(network.service_of(aggregator).await);
        network.serve().await;
        network
    }

    /// An operator's ledger in `dir`, which [`Self::start_again`] serves.
    pub fn of_operator(dir: TempDir, operator: Operator, config: Config) -> Self {
        let clock = Arc::new(ManualClock::at(operator.time_ms));
        let genesis = operator.state().genesis().clone();
        drop(operator);
        Self::stopped(dir, clock, genesis, config)
    }

    fn stopped(dir: TempDir, clock: Arc<ManualClock>, genesis: Genesis, config: Config) -> Self {
        Self {
            dir,
            clock,
            genesis,
            config,
            service: None,
            limits: Limits::default(),
            policy: None,
            beacons: None,
            address: String::new(),
            kept: Box::new(Blobs::at),
            blob_cache_bytes: None,
            keep_rounds: None,
            presigned: None,
            log_key: log_key(),
            running: None,
        }
    }

    async fn service_of(&self, aggregator: Aggregator) -> Service {
        let mut service = Service::with_limits(aggregator, self.limits);
        if let Some(beacons) = &self.beacons {
            service = service.with_beacons(beacons.clone());
        }
        if let Some(bytes) = self.blob_cache_bytes {
            service = service.with_blob_cache(bytes);
        }
        if let Some(rounds) = self.keep_rounds {
            service = service.with_kept_rounds(rounds);
        }
        if let Some(valid) = self.presigned {
            service = service.with_presigned_uploads(valid);
        }
        if let Some(policy) = &self.policy {
            let witnesses = Witnesses::new(policy.clone(), Duration::from_secs(2)).unwrap();
            service = service.witnessed(Arc::new(witnesses)).await.unwrap();
        }
        service
    }

    async fn serve(&mut self) {
        let listener = listen(([127, 0, 0, 1], 0).into()).unwrap();
        self.address = format!("http://{}", listener.local_addr().unwrap());
        let (stop, stopped) = oneshot::channel::<()>();
        let service = self.service().clone();
        let task = tokio::spawn(async move {
            let stopped = async {
                let _ = stopped.await;
            };
            service.serve(listener, stopped).await.unwrap();
        });
        self.running = Some((stop, task));
    }

    /// Kills and restarts the aggregator.
    pub async fn restart(&mut self) {
        let (stop, task) = self.running.take().unwrap();
        task.abort(); // The aggregator gets no time to end its work
        let _ = task.await;
        drop(stop);
        self.start_again().await;
    }

    /// Ends the aggregator and waits.
    pub async fn stop(&mut self) {
        let (stop, task) = self.running.take().unwrap();
        stop.send(()).unwrap();
        task.await.unwrap();
    }

    /// The aggregator from disk, once the one before it is gone.
    async fn opened_again(&mut self) -> Aggregator {
        // Requests and steps in progress hold clones of the old service, and so the database.
        self.service = None;
        until_async("the database is free", async || match self.open() {
            Err(error) if error.to_string().contains("in use") => None,
            opened => Some(opened.unwrap()),
        })
        .await
    }

    /// Ends the aggregator, and waits for the step in progress. It would wait for its bucket for ever, once that is gone.
    pub async fn end(&mut self) {
        self.stop().await;
        drop(self.opened_again().await);
    }

    /// Restarts from disk.
    pub async fn start_again(&mut self) {
        let aggregator = self.opened_again().await;
        self.service = Some(self.service_of(aggregator).await);
        self.serve().await;
        // It answers once what it does at the start is done.
        if let Ok(mut client) = FederationClient::connect(self.address.clone()).await {
            let _ = client.get_network(proto::GetNetworkRequest {}).await;
        }
    }

    /// Ends the aggregator if it runs, gives the log another key, and starts it again.
    pub async fn rotate_log_key(&mut self, key: SigningKey) {
        if self.running.is_some() {
            self.stop().await;
        }
        self.service = None;
        let dir = self.dir.path();
        let opened = until_async("the database is free", async || {
            let blobs = (self.kept)(dir);
            Ledger::open_to_rotate(dir, None, key.clone(), None, blobs, &mut ()).ok()
        });
        let mut ledger = opened.await;
        ledger.rotate_key(&log_key(), self.clock.now_ms()).unwrap();
        drop(ledger);
        self.log_key = key;
        self.start_again().await;
    }

    fn open(&self) -> Result<Aggregator, RequestError> {
        Aggregator::open_with(
            self.dir.path(),
            Some(&self.genesis.network_id()),
            self.log_key.clone(),
            self.clock.clone(),
            self.config,
            (self.kept)(self.dir.path()),
        )
    }

    /// Keeps blobs so from the next start.
    pub fn keep_blobs(&mut self, kept: impl Fn(&Path) -> Blobs + Send + Sync + 'static) {
        self.kept = Box::new(kept);
    }

    /// The running service.
    pub fn service(&self) -> &Service {
        self.service.as_ref().unwrap()
    }

    /// Polls until nothing changes.
    pub async fn settle(&self) {
        loop {
            match self.service().step().await {
                Ok(Polled::Did(_)) => {}
                Ok(_) | Err(RequestError::Clock(_)) => return,
                Err(error) => panic!("{error}"),
            }
        }
    }

    /// Closes the commitments, if needed past their deadline, and draws the randomness.
    pub async fn drawn(&self) {
        self.settle().await;
        let waits = |aggregator: &mut Aggregator| {
            let round = aggregator.state().round();
            Ok(round.is_some_and(|round| round.closing.is_none()))
        };
        if self.service().with(waits).await.unwrap() {
            self.clock.advance(COMMIT_MS + 1);
            self.settle().await;
        }
    }

    /// The ledger's entries.
    pub async fn entries(&self) -> Vec<Entry> {
        self.service()
            .with(|aggregator| {
                let ledger = aggregator.ledger();
                Ok((0..ledger.size())
                    .map(|at| ledger.entry(at).unwrap())
                    .collect())
            })
            .await
            .unwrap()
    }

    /// The newest entry.
    pub async fn last(&self) -> Body {
        self.entries().await.pop().unwrap().body
    }

    /// A client's own connection.
    pub async fn client(&self) -> FederationClient<Channel> {
        FederationClient::connect(self.address.clone())
            .await
            .unwrap()
    }

    /// A valid head for this statement.
    pub fn head(
        &self,
        key: &SigningKey,
        method: Method,
        round: Option<u64>,
        statement: &[u8],
    ) -> RequestHead {
        static HEADS: AtomicU64 = AtomicU64::new(0);
        let mut nonce = [0; 16];
        nonce[..8].copy_from_slice(&HEADS.fetch_add(1, Ordering::SeqCst).to_le_bytes());
        RequestHead {
            network: self.genesis.network_id(),
            run: self.service().run(),
            method,
            round,
            body: blob_digest(statement),
            sender: NodeId(key.verifying_key().to_bytes()),
            time_ms: self.clock.now_ms(),
            nonce,
        }
    }

    /// A request with a valid head.
    pub fn request<T>(
        &self,
        key: &SigningKey,
        method: Method,
        round: Option<u64>,
        statement: &[u8],
        message: T,
    ) -> tonic::Request<T> {
        let head = self.head(key, method, round, statement);
        with_head(message, &Signed::new(head, key))
    }

    /// Its signer's request to record `body`.
    pub fn recording(&self, body: &Body) -> tonic::Request<proto::RecordRequest> {
        let signer = SentStatement::read(with_leaves(body, Vec::new())).map(|sent| sent.signer());
        let signers = signer.iter().flat_map(|signer| {
            let nodes = (0..=255).map(SigningNode::new);
            nodes.filter(|node| node.id() == *signer)
        });
        let key = signers.map(|node| node.key).next().unwrap_or_else(log_key);
        self.stating(&key, body, Vec::new())
    }

    /// Report on this round, or the newest.
    pub async fn round(&self, round: Option<u64>) -> proto::RoundInfo {
        let request = proto::GetRoundRequest {
            round,
            node: Vec::new(),
        };
        self.client()
            .await
            .get_round(request)
            .await
            .unwrap()
            .into_inner()
    }

    /// Opens a receipt by the genesis.
    pub fn opened(&self, receipt: proto::Receipt) -> (u64, Checkpoint, Entry) {
        let receipt = Receipt {
            index: receipt.index,
            entry: receipt.entry,
            checkpoint: receipt.checkpoint.into_bytes(),
            proof: receipt
                .inclusion
                .into_iter()
                .map(|hash| Digest(hash.try_into().unwrap()))
                .collect(),
        };
        let index = receipt.index;
        let (checkpoint, entry) = receipt
            .verify(&self.genesis.log_key, &self.genesis.name)
            .unwrap();
        (index, checkpoint, entry)
    }

    /// Downloads a blob.
    pub async fn download(&self, blob: Digest) -> Result<Vec<u8>, Status> {
        let request = proto::DownloadRequest {
            blob: blob.0.to_vec(),
            begins: 0,
        };
        let mut stream = self.client().await.download(request).await?.into_inner();
        let mut bytes = Vec::new();
        while let Some(chunk) = stream.message().await? {
            bytes.extend(chunk.data);
        }
        Ok(bytes)
    }

    /// A download of the policy's file, 8 MiB long: more than a server and a slow client buffer. The server does not verify it.
    pub fn long_download(&self) -> proto::DownloadRequest {
        let policy = self.genesis.policy;
        let path = Blobs::at(self.dir.path()).path(&policy);
        let file = File::options().write(true).open(path).unwrap();
        file.set_len(LONG_BYTES).unwrap();
        proto::DownloadRequest {
            blob: policy.0.to_vec(),
            begins: 0,
        }
    }

    /// A client that buffers little.
    pub async fn slow_reader(&self) -> FederationClient<Channel> {
        let endpoint = Endpoint::try_from(self.address.clone()).unwrap();
        let endpoint = endpoint
            .initial_stream_window_size(1 << 16)
            .initial_connection_window_size(1 << 18);
        FederationClient::new(endpoint.connect_lazy())
    }

    /// Uploads in the folder.
    pub fn uploads(&self) -> usize {
        files(&self.dir.path().join("uploads"))
    }

    /// A metric by name and labels, of those that count events. `metrics_text` of the service also looks up the others.
    pub fn metric(&self, name: &str) -> u64 {
        let text = self.service().metrics().text().unwrap();
        let mut lines = text.lines();
        let value = lines.find_map(|line| line.strip_prefix(name)?.strip_prefix(' '));
        value.map_or(0, |value| value.parse().unwrap())
    }

    /// Waits for so many open requests.
    pub async fn in_progress(&self, method: &str, requests: u64) {
        let name = format!("zk0_requests_in_progress{{method=\"{method}\"}}");
        let what = format!("{requests} requests {method} are in progress");
        until_async(what, async || self.metric(&name) == requests).await;
    }

    /// Waits until a large message has memory.
    pub async fn large_message(&self) {
        let bytes = async || self.metric("zk0_message_bytes_in_flight") > 0;
        until_async("a large message has its memory", bytes).await;
    }
}

impl Drop for Network {
    /// The runtime's end would interrupt the server's draining.
    fn drop(&mut self) {
        if let Some((_, task)) = self.running.take() {
            task.abort();
        }
    }
}
