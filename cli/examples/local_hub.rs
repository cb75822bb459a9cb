//! Serves the Hub of the tests on loopback until it is stopped, so that Python's `huggingface_hub` can publish there: what it accepts of that client
//! is the Hub's API as others speak it. With an argument, it serves for so many seconds, and then prints what it holds.

use std::time::Duration;
use zk0_testkit::local_hub::{LocalHub, TOKEN};

fn main() {
    let seconds = std::env::args().nth(1).and_then(|given| given.parse().ok());
    let hub = LocalHub::start();
    hub.held().lenient = true;
    println!("HF_ENDPOINT={} HF_TOKEN={TOKEN}", hub.address);
    std::thread::sleep(Duration::from_secs(seconds.unwrap_or(u64::MAX)));
    for (name, model) in &hub.held().models {
        for commit in &model.commits {
            println!("{name}: {:?} changed {:?}", commit.summary, commit.changed);
        }
    }
}
