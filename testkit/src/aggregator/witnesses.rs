//! Witnesses on loopback, with ledgers.

use super::{genesis, log_key, ManualClock, SigningNode, START_MS};
use crate::until_async;
use ed25519_dalek::SigningKey;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;
use tempfile::TempDir;
use tokio::net::TcpListener;
use tokio::task::JoinHandle;
use zk0_aggregator::publish::cosigning::{ConsistencyProver, CosigningError, Witnesses};
use zk0_aggregator::publish::http;
use zk0_aggregator::publish::witness_server::WitnessServer;
use zk0_ledger::log::Ledger;
use zk0_ledger::witness_store::{WitnessError, WitnessStore};
use zk0_protocol::entries::entry::Body;
use zk0_protocol::entries::member::NodeEnrolled;
use zk0_protocol::tlog::cosigner::Cosigner;
use zk0_protocol::tlog::verifier_key::{Role, VerifierKey};
use zk0_protocol::WitnessPolicy;

/// The log's verifying key.
pub fn log_verifier() -> VerifierKey {
    VerifierKey::new(Role::Log, &genesis().name, &genesis().log_key).unwrap()
}

/// A witness's time in [`cosigned`].
pub const DEADLINE: Duration = Duration::from_secs(6);

/// A witness on loopback.
pub struct Running {
    number: u8,
    dir: TempDir,
    /// Host and port.
    pub address: String,
    task: Option<JoinHandle<()>>,
}

impl Running {
    /// Starts witness `number` with an empty folder.
    pub async fn start(number: u8) -> Self {
        let mut witness = Self {
            number,
            dir: tempfile::tempdir().unwrap(),
            address: "127.0.0.1:0".into(),
            task: None,
        };
        witness.on().await;
        witness
    }

    fn cosigner(&self) -> Cosigner {
        let secret = SigningKey::from_bytes(&[200 + self.number; 32]);
        Cosigner::new(&format!("witness.example/w{}", self.number), secret).unwrap()
    }

    /// Starts, at the former address if any.
    pub async fn on(&mut self) {
        // Its last request releases the folder.
        let store = until_async(
            "the witness' folder is free",
            async || match WitnessStore::open(
                self.dir.path(),
                self.cosigner(),
                vec![log_verifier()],
            ) {
                Err(WitnessError::Locked(_)) => None,
                opened => Some(opened.unwrap()),
            },
        );
        let store = store.await;
        let listener = TcpListener::bind(&self.address).await.unwrap();
        self.address = listener.local_addr().unwrap().to_string();
        let clock = Arc::new(ManualClock::at(START_MS));
        let router = WitnessServer::new(store, clock).router();
        let limits = WitnessServer::limits();
        let serving = http::serve(listener, router, limits, std::future::pending());
        self.task = Some(tokio::spawn(serving));
    }

    /// Stops the witness.
    pub async fn off(&mut self) {
        let task = self.task.take().unwrap();
        task.abort();
        let _ = task.await;
    }

    /// Its line in the policy.
    pub fn line(&self) -> String {
        let key = self.cosigner().key().to_string();
        format!("witness W{} {key} http://{}\n", self.number, self.address)
    }
}

/// Three witnesses, with a quorum of two.
pub async fn three() -> ([Running; 3], WitnessPolicy) {
    let witnesses = [
        Running::start(0).await,
        Running::start(1).await,
        Running::start(2).await,
    ];
    let lines: String = witnesses.iter().map(Running::line).collect();
    let policy = format!("{lines}group two 2 W0 W1 W2\nquorum two\n");
    (witnesses, WitnessPolicy::parse(&policy).unwrap())
}

/// Enrols a node.
pub fn enrol(ledger: &mut Ledger, node: u8) {
    let enrolled = NodeEnrolled {
        node: SigningNode::new(node).id(),
        name: "a node".into(),
    };
    ledger
        .append(START_MS, Body::NodeEnrolled(enrolled))
        .unwrap();
}

/// A ledger of enrolments.
pub fn ledger(dir: &Path, nodes: &[u8]) -> Ledger {
    let (mut ledger, _) = Ledger::create(dir, genesis(), log_key(), START_MS).unwrap();
    nodes.iter().for_each(|node| enrol(&mut ledger, *node));
    ledger
}

/// Cosignatures of the newest checkpoint.
pub async fn cosigned(
    policy: &WitnessPolicy,
    ledger: &Arc<Ledger>,
) -> Result<Vec<u8>, CosigningError> {
    let (policy, ledger) = (policy.clone(), ledger.clone());
    tokio::task::spawn_blocking(move || {
        let witnesses = Witnesses::new(policy, DEADLINE)?;
        let prove: ConsistencyProver = {
            let ledger = ledger.clone();
            Arc::new(move |old, new| {
                let proof = ledger.consistency_between(old, new);
                proof.map_err(|error| error.to_string())
            })
        };
        let cosigned = witnesses.cosign(ledger.checkpoint(), &prove)?;
        Ok(cosigned.note)
    })
    .await
    .unwrap()
}
