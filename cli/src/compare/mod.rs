//! `zk0 compare`: federated training against centralised training and single nodes, without proofs. A resumed comparison gives the same
//! results, byte for byte.

mod kept;
mod options;
mod prepared;
mod report;
mod search;

pub use options::CompareOptions;

use crate::output::println;
use anyhow::{Context, Result};
use kept::ComparisonFolder;
use prepared::PreparedRuns;
use std::fs;
use std::sync::Mutex;
use std::time::Instant;
use zk0_node::progress::Progress;
use zk0_protocol::counted::counted;
use zk0_simulate::compare::run::{measured_rounds, ComparisonSetting, Run};
use zk0_simulate::compare::variant::{Hyperparameters, Variant, VariantKind};
use zk0_simulate::rounds;

const NOT_PROVEN: &str =
    "nothing in this comparison is proven, signed or recorded: `zk0 demo` and real networks do that";

/// Measurements in a run, besides the start.
const MEASURED: u64 = 10;

/// Runs the command.
pub fn run(options: &CompareOptions) -> Result<()> {
    let out = &options.out;
    options.check()?;
    fs::create_dir_all(out).with_context(|| format!("creating {}", out.display()))?;
    println!("{NOT_PROVEN}");
    let clock = Instant::now();
    let prepared = PreparedRuns::open(options)?;
    let measured = measured_rounds(options.federation.rounds, MEASURED);
    let setting = prepared.setting(options, &options.dealing(), measured)?;
    let kept = ComparisonFolder::open(out, prepared.of, options.resume)?;
    let (values, searched) = if options.search {
        let (values, searched) = search::search(options, &prepared, &kept)?;
        (values, Some(searched))
    } else {
        let space = options.space();
        let given = VariantKind::ALL.map(|kind| space.given(kind));
        (given.to_vec(), None)
    };
    let runs = make(options, &prepared, &setting, &kept, &values)?;
    report::report(options, &setting, &values, &runs, searched)?;
    println!(
        "\n{} in {:.1} s; the results are in {}\n{NOT_PROVEN}",
        counted(runs.len() as u64, "run", "runs"),
        clock.elapsed().as_secs_f64(),
        out.display()
    );
    Ok(())
}

fn make(
    options: &CompareOptions,
    prepared: &PreparedRuns,
    setting: &ComparisonSetting,
    kept: &ComparisonFolder,
    values: &[Hyperparameters],
) -> Result<Vec<Run>> {
    let first = options.federation.seed;
    let seeds = first..first + options.seeds;
    let of_seed = |seed| {
        Variant::all(setting.nodes.len())
            .into_iter()
            .map(move |one| (one, seed))
    };
    let all: Vec<(Variant, u64)> = seeds.flat_map(of_seed).collect();
    let missing = all
        .iter()
        .filter(|(variant, seed)| !kept.has_run(*variant, *seed));
    let missing: Vec<_> = missing.copied().collect();
    let progress = Mutex::new((0, Progress::start("comparing", missing.len() as u64)));
    rounds::parallel(missing.len(), prepared.threads, |number| {
        let (variant, seed) = missing[number];
        let values = VariantKind::ALL.iter().zip(values);
        let values = values.filter(|(kind, _)| **kind == variant.kind());
        let start = prepared.start(options, seed)?;
        for (_, values) in values {
            let run = setting.run(variant, values, seed, &start, 1);
            let run = run.with_context(|| {
                format!(
                    "training with seed {seed}, {}",
                    variant.name(&setting.nodes)
                )
            })?;
            kept.keep_run(&run)?;
        }
        if let Ok(mut progress) = progress.lock() {
            progress.0 += 1;
            let done = progress.0;
            progress.1.reached(done);
        }
        anyhow::Ok(())
    })?;
    // From disk, as after an interruption.
    all.iter()
        .map(|(variant, seed)| kept.run(*variant, *seed))
        .collect()
}
