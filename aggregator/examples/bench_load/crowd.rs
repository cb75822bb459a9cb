//! Honest nodes beside connections that do harm: idle ones, half-open ones, some that send byte by byte, and some that send garbage.

use crate::figures::figure;
use crate::nodes::all_ask;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::Arc;
use std::time::Duration;
use tokio::io::AsyncWriteExt;
use tokio::net::{TcpSocket, TcpStream};
use tokio::task::JoinSet;
use tokio::time::{interval, sleep};
use zk0_aggregator::{Config, Limits};
use zk0_testkit::aggregator::{weights, Network, SigningNode};

const NODES: u16 = 200;
const IDLE: u32 = 2000;
const HALF_OPEN: u32 = 200;
const SLOW: u32 = 100;
/// Connections with garbage, each second.
const GARBAGE: u64 = 50;
/// How often both are measured, in turn. The medians count.
const TIMES: usize = 5;
/// What every client of HTTP/2 sends first, and an empty frame of settings.
const PREFACE: &[u8] = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\0\0\0\x04\0\0\0\0\0";

pub async fn measure() {
    let (mut alone, mut beside) = (vec![], vec![]);
    for time in 1..=TIMES {
        alone.push(honest_seconds(false).await);
        beside.push(honest_seconds(true).await);
        let (alone, beside) = (alone[time - 1], beside[time - 1]);
        eprintln!("{time} of {TIMES}: {alone:.2} s alone, {beside:.2} s beside the crowd");
    }
    let name = "honest_nodes_beside_a_crowd";
    figure(name, median(beside), Some(median(alone)), "s");
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// How long honest nodes take to register, upload and commit.
async fn honest_seconds(crowded: bool) -> f64 {
    let nodes: Vec<_> = (1..=NODES)
        .map(|seed| Arc::new(SigningNode::numbered(seed)))
        .collect();
    let of: Vec<&SigningNode> = nodes.iter().map(|node| &**node).collect();
    let config = Config {
        rounds: Some(1),
        min_nodes: NODES.into(),
    };
    let network = Arc::new(Network::start_with(&of, config, Limits::default()).await);
    let crowd = match crowded {
        true => Some(Crowd::gather(&network.address).await),
        false => None,
    };
    let registered = all_ask(&network, &nodes, |_, network, node| async move {
        node.register(&network).await
    })
    .await;
    network.settle().await;
    let committed = all_ask(&network, &nodes, |number, network, node| async move {
        let update = weights(number as u32 + 1);
        node.upload(&network, 0, &update).await?;
        node.commit(&network, 0, &update).await
    })
    .await;
    if let Some(crowd) = crowd {
        crowd.leave();
    }
    registered.seconds + committed.seconds
}

struct Crowd {
    silent: Vec<TcpStream>,
    noisy: JoinSet<()>,
    garbage: Arc<AtomicU32>,
}

impl Crowd {
    async fn gather(address: &str) -> Self {
        let mut silent = vec![];
        for number in 0..IDLE {
            let mut stream = from(number, address).await;
            let _ = stream.write_all(PREFACE).await; // The service may have closed it, which is its right
            silent.push(stream);
        }
        for number in 0..HALF_OPEN {
            silent.push(from(number, address).await);
        }
        let mut noisy = JoinSet::new();
        for number in 0..SLOW {
            let address = address.to_owned();
            noisy.spawn(async move {
                loop {
                    let mut stream = from(number, &address).await;
                    for byte in PREFACE {
                        if stream.write_all(&[*byte]).await.is_err() {
                            break;
                        }
                        sleep(Duration::from_millis(100)).await;
                    }
                }
            });
        }
        let garbage = Arc::new(AtomicU32::new(0));
        let (sent, address) = (garbage.clone(), address.to_owned());
        noisy.spawn(async move {
            let mut pause = interval(Duration::from_millis(1000 / GARBAGE));
            loop {
                pause.tick().await;
                let number = sent.fetch_add(1, Ordering::Relaxed);
                let mut stream = from(number, &address).await;
                let _ = stream.write_all(&[0xff; 4096]).await;
            }
        });
        Self {
            silent,
            noisy,
            garbage,
        }
    }

    fn leave(self) {
        eprintln!(
            "a crowd of {} silent and {SLOW} slow connections, and {} with garbage",
            self.silent.len(),
            self.garbage.load(Ordering::Relaxed)
        );
        drop(self.noisy);
    }
}

/// Connects from one of 200 other addresses of loopback, to which the limits of strangers apply.
async fn from(number: u32, url: &str) -> TcpStream {
    let socket = TcpSocket::new_v4().expect("a socket");
    let host = (number % 200) as u8 + 1;
    socket
        .bind(([127, 0, 1, host], 0).into())
        .expect("an address of loopback");
    let address = url.strip_prefix("http://").expect("not encrypted");
    socket
        .connect(address.parse().expect("an address"))
        .await
        .expect("the service listens")
}
