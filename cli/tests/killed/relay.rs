//! A relay between nodes and the aggregator, which can hold back what the aggregator answers.

use std::io::{Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::Arc;
use std::thread;

/// A running relay.
pub struct Relay {
    pub url: String,
    held: Arc<AtomicBool>,
}

impl Relay {
    /// A relay to this address. While nobody listens there, whoever connects loses the connection.
    pub fn to(address: &str) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let url = format!("http://{}", listener.local_addr().unwrap());
        let held = Arc::new(AtomicBool::new(false));
        let (address, hold) = (address.to_owned(), held.clone());
        thread::spawn(move || {
            for client in listener.incoming().map_while(Result::ok) {
                if let Ok(server) = TcpStream::connect(&address) {
                    connect(client, server, &hold);
                }
            }
        });
        Self { url, held }
    }

    /// From now on, no answer reaches a node.
    pub fn hold(&self) {
        self.held.store(true, Ordering::SeqCst);
    }

    /// From now on, answers on new connections reach the nodes.
    pub fn let_through(&self) {
        self.held.store(false, Ordering::SeqCst);
    }
}

fn connect(client: TcpStream, server: TcpStream, held: &Arc<AtomicBool>) {
    let (to_client, to_server) = (client.try_clone().unwrap(), server.try_clone().unwrap());
    let held = held.clone();
    thread::spawn(move || copy(client, to_server, || false));
    thread::spawn(move || copy(server, to_client, || held.load(Ordering::SeqCst)));
}

/// Copies until the end. Once something was held back, nothing that follows may pass: it would be another answer's.
fn copy(mut from: TcpStream, mut to: TcpStream, held: impl Fn() -> bool) {
    let mut buffer = [0; 16 << 10];
    let mut lost = false;
    while let Ok(read @ 1..) = from.read(&mut buffer) {
        lost |= held();
        if !lost && to.write_all(&buffer[..read]).is_err() {
            break;
        }
    }
    let _ = to.shutdown(Shutdown::Both);
    let _ = from.shutdown(Shutdown::Both);
}
