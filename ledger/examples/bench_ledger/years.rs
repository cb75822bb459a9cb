//! What a long history costs: the start of an aggregator, and the audit of one more day. The peer of a figure is its aim.

use crate::network::{enrolments, grow, record, with_nodes, TIME};
use crate::{figure, measured, print_measured};
use anyhow::{bail, Result};
use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};
use zk0_ledger::replay::{replay_with, ReplayOptions, SaveOptions, SavedReplay, Verdict};
use zk0_ledger::{folder, Ledger};
use zk0_testkit::network::log_key;

const NODES: u64 = 100;

/// Entries of one round.
const ROUND: u64 = 2 * NODES + 4;

/// The most new entries that a start reads without keeping its state again.
const NEWER: u64 = 4095;

/// Rounds of one day.
const DAY: u64 = 24;

/// Seconds and megabytes of a start from the kept state.
const KEPT_AIM: [f64; 2] = [10.0, 200.0];

/// How many times more a start may take, or need, at the whole history than at a tenth.
const GROWTH_AIM: f64 = 1.2;

/// Seconds of a start without a kept state, and of the audit of one more day.
const REPLAYED_AIM: f64 = 180.0;
const NIGHTLY_AIM: f64 = 30.0;

/// A start is measured so often. The fastest counts, because other processes slow it down.
const STARTS: usize = 3;

/// With fewer rounds, a start at a tenth of them keeps no state.
const FEWEST: u64 = 300;

/// Measures a history of so many rounds, which is made in `dir`.
pub fn measure(dir: &Path, rounds: u64) -> Result<()> {
    if rounds < FEWEST {
        bail!("a history has at least {FEWEST} rounds, not {rounds}");
    }
    let scratch = tempfile::tempdir_in(dir)?;
    let [ledger, state] = ["ledger", "audit.state"].map(|name| scratch.path().join(name));
    drop(with_nodes(&ledger, NODES)?);
    extend(&ledger, rounds / 10)?;
    started(&ledger)?;
    let tenth = kept(&ledger, "years_start_kept_tenth")?;

    extend(&ledger, rounds)?;
    fs::remove_file(folder::state(&ledger))?;
    let [_, seconds, _] = started(&ledger)?;
    let unit = "s; without a kept state";
    figure("years_start_replayed", seconds, REPLAYED_AIM, true, unit);
    let whole = kept(&ledger, "years_start_kept")?;
    for (at, what) in ["seconds", "memory"].into_iter().enumerate() {
        let growth = whole[at] / tenth[at];
        let bench = format!("years_start_kept_{what}_growth");
        let unit = "times that of a tenth of the history";
        figure(&bench, growth, GROWTH_AIM, true, unit);
    }

    extend_by(&ledger, NEWER)?;
    kept(&ledger, "years_start_kept_most_new")?;

    audited(&ledger, &state)?;
    extend(&ledger, rounds + NEWER / ROUND + DAY)?;
    let [_, seconds, _] = audited(&ledger, &state)?;
    let unit = "s; entries, rules and signatures of one more day, without files";
    figure("years_nightly_audit", seconds, NIGHTLY_AIM, true, unit);
    Ok(())
}

/// Goes on with the ledger until it has had so many rounds.
fn extend(dir: &Path, rounds: u64) -> Result<()> {
    eprintln!("{rounds} rounds …");
    let mut ledger = Ledger::open(dir, None, log_key())?;
    grow(&mut ledger, NODES, |ledger| {
        ledger.state().next_round() < rounds
    })
}

/// Goes on with the ledger by so many entries: rounds, and enrolments as the rest.
fn extend_by(dir: &Path, entries: u64) -> Result<()> {
    eprintln!("{entries} entries more …");
    let mut ledger = Ledger::open(dir, None, log_key())?;
    let whole = ledger.size() + entries;
    grow(&mut ledger, NODES, |ledger| ledger.size() + ROUND <= whole)?;
    let rest = whole - ledger.size();
    record(&mut ledger, TIME, enrolments(NODES..NODES + rest))?;
    Ok(())
}

/// Starts an aggregator in a process of its own, so that the memory is the start's alone. It keeps its state if much is new.
fn started(dir: &Path) -> Result<[f64; 3]> {
    let start = std::env::current_exe()?.with_file_name("bench_start");
    measured(Command::new(start).arg(dir))
}

/// Measures a start from the kept state, and returns its seconds and megabytes.
fn kept(dir: &Path, bench: &str) -> Result<[f64; 2]> {
    let mut best = [f64::MAX; 2];
    for _ in 0..STARTS {
        let [_, seconds, peak] = started(dir)?;
        best = [best[0].min(seconds), best[1].min(peak * 1024.0 / 1e6)];
    }
    for (at, unit) in ["s", "MB"].into_iter().enumerate() {
        figure(
            &format!("{bench}_{unit}"),
            best[at],
            KEPT_AIM[at],
            true,
            unit,
        );
    }
    Ok(best)
}

fn audited(dir: &Path, state: &Path) -> Result<[f64; 3]> {
    eprintln!("audit …");
    let mut audit = Command::new(std::env::current_exe()?);
    measured(audit.arg("audit").arg(dir).arg(state))
}

/// Audits the ledger from a state file on, and replaces that. Prints what [`measured`] takes.
pub fn audit_here(dir: &Path, state: &Path) -> Result<()> {
    let started = Instant::now();
    let options = ReplayOptions {
        from: SavedReplay::read(state)?,
        keep: Some(SaveOptions {
            path: state.into(),
            every: Duration::MAX,
        }),
        ..ReplayOptions::default()
    };
    let report = replay_with(dir, options, &mut ());
    let seconds = started.elapsed().as_secs_f64();
    if report.verdict != Verdict::Verified || report.unsaved.is_some() {
        bail!("{:?}", report.findings);
    }
    print_measured(report.entries, seconds)
}
