//! Measures an aggregator under load, on loopback only. Run it with `make bench-load`.
//!
//! ```text
//! bench_load round NODES               one round of so many nodes, all at once
//! bench_load crowd                     honest nodes beside connections that do harm
//! bench_load uploads NODES MEGABYTES   large updates, all at once
//! bench_load distance MEGABYTES        an update from far away
//! ```
//!
//! Nodes and aggregator are in this one process, and share its cores. It prints one JSON line for each figure on standard output, and its
//! progress on standard error. `ratio` compares our figure with the peer's: more than 1 means that ours is better. Where there is no peer,
//! both are null.

mod crowd;
mod distance;
mod figures;
mod nodes;
mod round;
mod uploads;

#[tokio::main]
async fn main() {
    rlimit::increase_nofile_limit(u64::MAX).expect("the limit of open files can be raised");
    let arguments: Vec<_> = std::env::args().skip(1).collect();
    let arguments: Vec<_> = arguments.iter().map(String::as_str).collect();
    match arguments[..] {
        ["round", nodes] => round::measure(number(nodes)).await,
        ["crowd"] => crowd::measure().await,
        ["uploads", nodes, megabytes] => {
            uploads::measure(number(nodes), number(megabytes).into()).await;
        }
        ["distance", megabytes] => distance::measure(number(megabytes).into()).await,
        _ => {
            panic!("bench_load round NODES | crowd | uploads NODES MEGABYTES | distance MEGABYTES")
        }
    }
}

fn number(text: &str) -> u16 {
    text.parse()
        .unwrap_or_else(|error| panic!("{text}: {error}"))
}
