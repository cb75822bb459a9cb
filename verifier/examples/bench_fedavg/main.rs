//! Measures FedAvg of many updates, from their files to a file of new weights. `scripts/bench-fedavg/run.sh` runs it beside Flower's.
//!
//! ```text
//! bench_fedavg make PROFILE UPDATES FOLDER     writes files of weights
//! bench_fedavg average PROFILE FOLDER          averages them to FOLDER/result.safetensors, as the closing of a round does
//! bench_fedavg bandwidth PROFILE FOLDER        the averaging alone, in memory, beside the speed at which memory can be read
//! ```
//!
//! Each of the latter two prints JSON lines.

mod bandwidth;
mod updates;

use std::fs::{self, File};
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::time::Instant;
use updates::{files, make, Average};
use zk0_circuits::model::spec::Dims;
use zk0_circuits::{EvalSpec, Mode};
use zk0_verifier::combine::sealed::{Sealed, SealedFile};
use zk0_verifier::Evaluation;

// The allocator of `zk0`.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() {
    let arguments: Vec<_> = std::env::args().skip(1).collect();
    let arguments: Vec<_> = arguments.iter().map(String::as_str).collect();
    match arguments[..] {
        ["make", profile, updates, folder] => {
            let updates = updates.parse().expect("UPDATES is a number");
            make(&evaluation(profile), updates, Path::new(folder));
        }
        ["average", profile, folder] => average(&evaluation(profile), Path::new(folder)),
        ["bandwidth", profile, folder] => {
            bandwidth::measure(&evaluation(profile), Path::new(folder));
        }
        _ => panic!("bench_fedavg make PROFILE UPDATES FOLDER | average PROFILE FOLDER | bandwidth PROFILE FOLDER"),
    }
}

fn evaluation(profile: &str) -> Evaluation {
    let spec = match profile {
        "full" => EvalSpec::new(Dims::FULL),
        "micro" => EvalSpec::micro(),
        other => panic!("the profiles are full and micro, not {other}"),
    };
    Evaluation::new(&spec, Mode::Succinct).expect("the profile is valid")
}

/// From files whose contributions were verified, to the file of the new weights and its digests.
fn average(evaluation: &Evaluation, folder: &Path) {
    let (format, files) = (evaluation.format(), files(folder));
    // A node's update is sealed when it is verified, long before.
    let seal = |(path, _): &(_, _)| {
        let weights = format
            .read(&fs::read(path).expect("reading"))
            .expect("weights");
        Sealed::of(format, &weights)
    };
    let sealed: Vec<_> = files.iter().map(seal).collect();
    forget_peak();
    let before = peak_memory();
    let started = Instant::now();
    let read_at = |blob: &_, place, buffer: &mut [u8]| {
        let file = files.iter().find(|(_, other)| other == blob);
        let (path, _) = file.expect("it is one of these");
        File::open(path)?.read_exact_at(buffer, place)
    };
    let pairs = files.iter().zip(&sealed);
    let updates = pairs.map(|((_, blob), sealed)| SealedFile::new(format, sealed, *blob, &read_at));
    let updates: Vec<_> = updates.collect();
    let average = Average::of(
        format,
        &files[0].0,
        updates.iter().map(|update| update as _),
    );
    let file = average.file();
    let combined = started.elapsed();
    let digest = evaluation
        .digest_of(&file)
        .expect("it is a file of weights");
    let digested = started.elapsed();
    fs::write(folder.join("result.safetensors"), file.bytes()).expect("writing");
    let written = started.elapsed();
    println!(
        "{}",
        serde_json::json!({
            "side": "ours",
            "updates": files.len(),
            "weights": format.tensors().iter().map(|tensor| tensor.len()).sum::<usize>(),
            "seconds": digested.as_secs_f64(),
            "combining_seconds": combined.as_secs_f64(),
            "digests_seconds": (digested - combined).as_secs_f64(),
            "with_writing_seconds": written.as_secs_f64(),
            "memory_before_bytes": before,
            "peak_memory_bytes": peak_memory(),
            "result": digest.blob.to_string(),
        })
    );
}

/// Gives back what is free, and lets the peak of memory begin anew.
fn forget_peak() {
    // SAFETY: this frees nothing that is in use.
    unsafe { libmimalloc_sys::mi_collect(true) };
    fs::write("/proc/self/clear_refs", "5").expect("Linux counts the peak anew");
}

/// The most memory that this process has had, in bytes. No file is mapped, so that this is memory of its own, and the program.
fn peak_memory() -> u64 {
    let status = fs::read_to_string("/proc/self/status").expect("Linux states it");
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kilobytes = line.and_then(|line| line.split_whitespace().next());
    1024 * kilobytes
        .and_then(|number| number.parse::<u64>().ok())
        .expect("a number")
}
