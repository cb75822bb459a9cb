//! Measures how fast a ledger is on this machine, and how fast its parts are by themselves: RocksDB, SHA-256 and ed25519. Run it with
//! `make bench-ledger`. `make bench-years` measures a long history.
//!
//! It prints one JSON line for each figure on standard output, and its progress on standard error. `ratio` compares our figure with the
//! peer's: more than 1 means that ours is better. It makes its files in `--dir`, or else where temporary files go. `--only` measures
//! just the figures whose names begin with its argument.

mod network;
mod peers;
mod years;

use anyhow::{bail, Context, Result};
use network::{empty_rounds, enrolments, founded, grown, registrations};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;
use zk0_ledger::replay::{replay, Verdict};
use zk0_ledger::{Blobs, Ledger};
use zk0_protocol::Body;
use zk0_verifier::{check_proof, ProgramKey};

/// How many entries a group has.
const GROUP: usize = 1000;

/// Seconds in which a million entries should be replayed.
const REPLAY_AIM: f64 = 90.0;

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let mut arguments = arguments.iter().map(String::as_str);
    let mut options = Options {
        dir: std::env::temp_dir(),
        entries: 1_000_000,
        only: String::new(),
    };
    while let Some(argument) = arguments.next() {
        let mut value = || {
            arguments
                .next()
                .with_context(|| format!("{argument} what?"))
        };
        match argument {
            "replay" => return replay_here(Path::new(value()?)),
            "audit" => return years::audit_here(Path::new(value()?), Path::new(value()?)),
            "years" => return years::measure(&options.dir, value()?.parse()?),
            "grow" => return grown(Path::new(value()?), value()?.parse()?),
            "--dir" => options.dir = value()?.into(),
            "--entries" => options.entries = value()?.parse()?,
            "--only" => options.only = value()?.into(),
            other => {
                bail!("{other}? There are --dir DIR, --entries N (of the replay) and --only NAME")
            }
        }
    }
    options.append("append_rounds", |ledger| {
        Ok(empty_rounds(ledger.state(), 100_000))
    })?;
    options.append("append_enrolments", |_| Ok(enrolments(0..300_000)))?;
    options.append("append_signed_by_nodes", |ledger| {
        network::record(ledger, network::TIME, enrolments(0..network::NODES))?;
        Ok(registrations(ledger.state(), network::NODES, 400))
    })?;
    options.wanted("append_with_receipts", || receipts(&options.dir))?;
    options.wanted("sp1_proofs", proofs)?;
    options.wanted("replay", || replays(&options.dir, options.entries))?;
    options.wanted("start", || start(&options.dir, options.entries))
}

struct Options {
    dir: PathBuf,
    /// How many entries the longer replay has.
    entries: u64,
    only: String,
}

impl Options {
    /// Measures, if the user wants this figure.
    fn wanted(&self, bench: &str, measure: impl FnOnce() -> Result<()>) -> Result<()> {
        match bench.starts_with(&self.only) {
            true => measure(),
            false => Ok(()),
        }
    }

    fn append(&self, bench: &str, make: impl Fn(&mut Ledger) -> Result<Vec<Body>>) -> Result<()> {
        self.wanted(bench, || appends(&self.dir, bench, make))
    }
}

/// Prints a figure. `ours` and `peer` are better when larger, unless `smaller` is.
fn figure(bench: &str, ours: f64, peer: f64, smaller: bool, unit: &str) {
    let ratio = if smaller { peer / ours } else { ours / peer };
    println!(
        "{}",
        serde_json::json!({"bench": bench, "ours": ours, "peer": peer, "ratio": ratio, "unit": unit})
    );
}

/// Measures how fast the ledger appends, in groups, the entries that `make` returns.
fn appends(dir: &Path, bench: &str, make: impl Fn(&mut Ledger) -> Result<Vec<Body>>) -> Result<()> {
    eprintln!("{bench} …");
    let scratch = tempfile::tempdir_in(dir)?;
    let mut ledger = founded(scratch.path())?;
    let mut rest = make(&mut ledger)?.into_iter();
    let (first, count) = (ledger.size(), rest.len() as f64);
    let mut groups = Vec::new();
    while rest.len() > 0 {
        groups.push(rest.by_ref().take(GROUP).collect::<Vec<_>>());
    }
    let started = Instant::now();
    for group in groups {
        network::record(&mut ledger, network::TIME, group)?;
    }
    let ours = count / started.elapsed().as_secs_f64();
    drop(ledger);
    let written = peers::written(scratch.path(), first, GROUP as u64)?;
    let raw = tempfile::tempdir_in(dir)?;
    let signed = bench.contains("signed");
    let peer = count / peers::raw_writes(&written, raw.path(), signed)?;
    let unit = "entries/s, groups of 1000, each on disk and signed";
    figure(bench, ours, peer, false, unit);
    Ok(())
}

/// Measures what it costs to hand out a receipt for each entry as well.
fn receipts(dir: &Path) -> Result<()> {
    let appended = |receipts: bool| -> Result<f64> {
        let scratch = tempfile::tempdir_in(dir)?;
        let mut ledger = founded(scratch.path())?;
        let bodies = empty_rounds(ledger.state(), 33_000);
        let (count, started) = (bodies.len() as f64, Instant::now());
        for group in bodies.chunks(GROUP) {
            network::record(&mut ledger, network::TIME, group.to_vec())?
                .into_iter()
                .filter(|_| receipts)
                .try_for_each(|entry| ledger.first_receipt(entry).map(drop))?;
        }
        Ok(count / started.elapsed().as_secs_f64())
    };
    let unit = "entries/s; the peer hands out no receipts";
    figure(
        "append_with_receipts",
        appended(true)?,
        appended(false)?,
        false,
        unit,
    );
    Ok(())
}

fn proofs() -> Result<()> {
    const TIMES: u32 = 50;
    eprintln!("proofs …");
    let dir = PathBuf::from(concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../tests/fixtures/ledger"
    ));
    let store = zk0_ledger::store::Store::open_read_only(&zk0_ledger::folder::database(&dir))?;
    let mut program = None;
    let mut found = None;
    for index in 0..store.size()? {
        let bytes = store.entry(index)?.context("an entry")?;
        match zk0_protocol::Entry::decode(&bytes)?.body {
            Body::Genesis(genesis) => program = Some(genesis.program),
            Body::ContributionAccepted(submission) => found = Some(submission.statement),
            _ => {}
        }
    }
    let (program, submission) = program
        .zip(found)
        .context("the committed ledger has no accepted contribution")?;
    let (key, program) = (&program, ProgramKey::from_bytes(&program)?);
    let proof = Blobs::at(&dir).get(&submission.proof, 16 << 20)?;
    let started = Instant::now();
    for _ in 0..TIMES {
        check_proof(&proof, &submission.claim, &program).map_err(anyhow::Error::from)?;
    }
    let ours = f64::from(TIMES) / started.elapsed().as_secs_f64();
    let peer = peers::sp1_verifications(TIMES, &proof, &submission.claim, key)?;
    let peer = f64::from(TIMES) / peer;
    figure("sp1_proofs", ours, peer, false, "proofs/s on one core");
    Ok(())
}

fn replays(dir: &Path, entries: u64) -> Result<()> {
    let mut peaks = Vec::new();
    for entries in [entries / 10, entries / 2, entries] {
        eprintln!("replay of {entries} entries …");
        let scratch = tempfile::tempdir_in(dir)?;
        grown(scratch.path(), entries)?;
        // The replay runs in a process of its own, so that the memory is the replay's alone.
        let mut replay = Command::new(std::env::current_exe()?);
        let [count, seconds, peak] = measured(replay.arg("replay").arg(scratch.path()))?;
        peaks.push(peak);
        let peer = peers::bare_verification(scratch.path())?;
        let bench = format!("replay_{entries}");
        figure(&bench, count / seconds, count / peer, false, "entries/s");
        let aim = REPLAY_AIM * entries as f64 / 1e6;
        figure(&format!("{bench}_aim"), seconds, aim, true, "s");
    }
    let [tenth, half, whole] = peaks[..] else {
        bail!("three replays")
    };
    for (shorter, name) in [(tenth, "a tenth"), (half, "half")] {
        let unit = format!("MiB; the peer is {name} of the entries");
        let (ours, peer) = (whole / 1024.0, shorter / 1024.0);
        figure("replay_peak_memory", ours, peer, true, &unit);
    }
    Ok(())
}

/// Measures how long an aggregator takes to start on a ledger of so many entries.
fn start(dir: &Path, entries: u64) -> Result<()> {
    eprintln!("start on {entries} entries …");
    let scratch = tempfile::tempdir_in(dir)?;
    grown(scratch.path(), entries)?;
    let start = std::env::current_exe()?.with_file_name("bench_start");
    let [_, seconds, _] = measured(Command::new(start).arg(scratch.path()))?;
    let peer = peers::bare_verification(scratch.path())?;
    let unit = "s; the peer verifies as many signatures and hashes the entries";
    figure(&format!("start_{entries}"), seconds, peer, true, unit);
    Ok(())
}

/// Runs a process that prints a number of entries, seconds and its most memory in KiB.
fn measured(process: &mut Command) -> Result<[f64; 3]> {
    let output = process.output().with_context(|| format!("{process:?}"))?;
    let reported = String::from_utf8_lossy(&output.stdout);
    let numbers: Option<Vec<f64>> = reported
        .split_whitespace()
        .map(|number| number.parse().ok())
        .collect();
    let numbers = numbers.and_then(|numbers| <[f64; 3]>::try_from(numbers).ok());
    numbers.with_context(|| format!("{reported}{}", String::from_utf8_lossy(&output.stderr)))
}

/// Replays the ledger, and prints the number of entries, the seconds and the most memory that this process had, in KiB.
fn replay_here(dir: &Path) -> Result<()> {
    let started = Instant::now();
    let report = replay(dir, None, &mut ());
    let seconds = started.elapsed().as_secs_f64();
    if report.verdict != Verdict::Verified {
        bail!("{:?}", report.findings);
    }
    print_measured(report.entries, seconds)
}

/// Prints the number of entries, the seconds and the most memory that this process had, in KiB.
fn print_measured(entries: u64, seconds: f64) -> Result<()> {
    let status = std::fs::read_to_string("/proc/self/status")?;
    let peak = status
        .lines()
        .find_map(|line| line.strip_prefix("VmHWM:")?.strip_suffix("kB"))
        .context("no VmHWM in /proc/self/status")?;
    println!("{entries} {seconds} {}", peak.trim());
    Ok(())
}
