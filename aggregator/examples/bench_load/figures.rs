//! Figures as JSON lines, and the memory of this process.

use serde_json::json;

/// Prints a figure where less is better, beside the peer's.
pub fn figure(bench: &str, ours: f64, peer: Option<f64>, unit: &str) {
    let ratio = peer.map(|peer| peer / ours);
    println!(
        "{}",
        json!({"bench": bench, "ours": ours, "peer": peer, "ratio": ratio, "unit": unit})
    );
}

/// The most memory that this process has had, in MiB.
pub fn peak_memory() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").expect("Linux has this file");
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kilobytes = line.and_then(|line| line.split_whitespace().next());
    let kilobytes: f64 = kilobytes.expect("it names the peak").parse().expect("kB");
    kilobytes / 1024.0
}
