//! Many nodes that ask at once.

use std::error::Error;
use std::future::Future;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::Semaphore;
use tokio::task::JoinSet;
use tonic::{Code, Status};
use zk0_testkit::aggregator::{Network, SigningNode};

/// How many nodes have a request in progress. Each holds its message, and they are in the aggregator's process.
const AT_ONCE: usize = 256;

/// What nodes have been answered.
pub struct Answers<T> {
    /// By number of the node.
    pub all: Vec<T>,
    pub seconds: f64,
    /// How often a node asked again.
    pub repeated: usize,
}

/// Lets all nodes ask. A node that is told to ask later, or whose connection is lost, asks again, as `zk0 node` would.
pub async fn all_ask<T, F>(
    network: &Arc<Network>,
    nodes: &[Arc<SigningNode>],
    ask: impl Fn(usize, Arc<Network>, Arc<SigningNode>) -> F + Clone + Send + 'static,
) -> Answers<T>
where
    T: Send + 'static,
    F: Future<Output = Result<T, Status>> + Send,
{
    let started = Instant::now();
    let repeated = Arc::new(AtomicUsize::new(0));
    let places = Arc::new(Semaphore::new(AT_ONCE));
    let mut asking = JoinSet::new();
    for (number, node) in nodes.iter().cloned().enumerate() {
        let (network, ask) = (network.clone(), ask.clone());
        let (repeated, places) = (repeated.clone(), places.clone());
        asking.spawn(async move {
            let _place = places.acquire().await.expect("nobody closes it");
            let mut wait = Duration::from_millis(50);
            loop {
                match ask(number, network.clone(), node.clone()).await {
                    Ok(answer) => return (number, answer),
                    Err(status) if may_be_repeated(&status) => {
                        repeated.fetch_add(1, Ordering::Relaxed);
                        tokio::time::sleep(wait).await;
                        wait = (wait * 2).min(Duration::from_secs(5));
                    }
                    Err(status) => panic!("node {number}: {status}"),
                }
            }
        });
    }
    let mut answers = asking.join_all().await;
    answers.sort_by_key(|(number, _)| *number);
    Answers {
        all: answers.into_iter().map(|(_, answer)| answer).collect(),
        seconds: started.elapsed().as_secs_f64(),
        repeated: repeated.load(Ordering::Relaxed),
    }
}

fn may_be_repeated(status: &Status) -> bool {
    // What an aggregator answers has no source.
    let lost = status.source().is_some();
    lost || matches!(status.code(), Code::Unavailable | Code::ResourceExhausted)
}
