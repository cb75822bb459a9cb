//! How fast the averaging alone is, beside how fast this machine reads memory: the exact sums, and then also the rounding to a file.

use crate::updates::{files, Average};
use rayon::prelude::*;
use std::fs;
use std::path::Path;
use std::time::Instant;
use zk0_verifier::combine::source::{WeightSource, WeightsInMemory};
use zk0_verifier::Evaluation;

/// Averages the updates in a folder from memory, and reads as much memory without doing anything with it. Each is done a few times, in
/// turn, and the fastest counts: machines that share their memory get slower and faster by themselves.
pub fn measure(evaluation: &Evaluation, folder: &Path) {
    let format = evaluation.format();
    let files = files(folder);
    let read = |(path, _): &(_, _)| {
        format
            .read(&fs::read(path).expect("reading"))
            .expect("weights")
    };
    let weights: Vec<_> = files.iter().map(read).collect();
    let updates = weights
        .iter()
        .map(|weights| WeightsInMemory { format, weights });
    let updates: Vec<_> = updates.collect();
    let sources = updates.iter().map(|update| update as &dyn WeightSource);
    let average = Average::of(format, &files[0].0, sources);
    let bytes: usize = weights.iter().map(|weights| weights.as_bytes().len()).sum();
    let [mut whole, mut averaging, mut reading] = [f64::INFINITY; 3];
    for _ in 0..5 {
        whole = whole.min(seconds(|| average.file()));
        averaging = averaging.min(seconds(|| average.sums()));
        reading = reading.min(seconds(|| {
            weights.iter().map(|one| sum(one.as_bytes())).sum::<u64>()
        }));
    }
    for (side, seconds) in [
        ("averaging", averaging),
        ("averaging and rounding", whole),
        ("machine", reading),
    ] {
        let bytes_per_second = bytes as f64 / seconds;
        let line = serde_json::json!({ "side": side, "bytes": bytes, "bytes_per_second": bytes_per_second });
        println!("{line}");
    }
}

fn seconds<T>(work: impl FnOnce() -> T) -> f64 {
    let started = Instant::now();
    std::hint::black_box(work());
    started.elapsed().as_secs_f64()
}

/// The sum of all words, by all cores.
fn sum(bytes: &[u8]) -> u64 {
    let chunks = bytes.par_chunks(1 << 20).map(|chunk| {
        let mut sums = [0u64; 16];
        for words in chunk.as_chunks::<8>().0.as_chunks::<16>().0 {
            for (sum, word) in sums.iter_mut().zip(words) {
                *sum = sum.wrapping_add(u64::from_le_bytes(*word));
            }
        }
        sums.iter()
            .fold(0u64, |one, other| one.wrapping_add(*other))
    });
    chunks.reduce(|| 0, u64::wrapping_add)
}
