//! `zk0 node estimate`: the cost of a claim on this machine.

use crate::dataset::{CameraNames, RecordingName};
use crate::output::{eprintln, print, println};
use crate::policy::refuse_unfit;
use anyhow::{bail, Result};
use std::path::Path;
use zk0_argument::claim::most_samples;
use zk0_circuits::claim::challenge::MAX_EVAL_SAMPLES;
use zk0_circuits::{EvalSpec, Mode};
use zk0_lerobot::dataset::RenameMap;
use zk0_prover::machine::Resources;
use zk0_prover::measure;
use zk0_prover::program::Executor;
use zk0_smolvla::measure::fixed_point::dims;
use zk0_smolvla::policy::policy_file;
use zk0_smolvla::{PolicyConfig, Profile};

/// `zk0 node estimate`.
#[derive(Debug, clap::Args)]
pub struct EstimateOptions {
    /// The size of the policy: micro, tiny or full (the published size); or a network's policy file.
    #[arg(long, default_value = "micro")]
    model: String,
    /// How the evaluation is proven, as the network's genesis states: direct, which sends samples to the proving service, or succinct, which
    /// does not. In mode succinct this makes arguments about two and three samples, which takes minutes and gigabytes at the published size.
    #[arg(long, default_value = "direct")]
    mode: Mode,
    /// The number of samples that a claim evaluates, within the bounds of the network's rules.
    #[arg(long, default_value_t = 16, value_parser = clap::value_parser!(u32).range(2..=MAX_EVAL_SAMPLES as i64))]
    samples: u32,
    /// Check that this recording fits the policy and the number of samples (a LeRobotDataset folder, or hub:owner/name[@revision]).
    #[arg(long, value_name = "RECORDING")]
    dataset: Option<RecordingName>,
    #[command(flatten)]
    cameras: CameraNames,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub async fn run(options: &EstimateOptions) -> Result<()> {
    let config = match Profile::from_name(&options.model) {
        Ok(profile) => profile.config(),
        Err(unknown) => match policy_file::load(Path::new(&options.model)) {
            Ok(file) => file.policy.config,
            Err(error) => bail!(
                "{unknown}; and {} cannot be read as a policy file: {error}",
                options.model
            ),
        },
    };
    if let Some(recording) = &options.dataset {
        check_fit(
            recording,
            &options.cameras.rename_map,
            &config,
            options.samples,
        )?;
    }
    let spec = EvalSpec::new(dims(&config)?);
    check_samples(options.mode, &spec, options.samples)?;
    if !options.json {
        eprintln!("zk0 counts the cycles: it executes the guest program on random weights and samples of this size");
    }
    let machine = Resources::of_this_machine()?;
    let executor = Executor::new().await?;
    let estimate =
        measure::Estimate::of(&executor, &spec, options.mode, options.samples, machine).await?;
    if options.json {
        println!("{}", serde_json::to_string(&estimate)?)
    } else {
        print!("{}", table(&options.model, &estimate))
    }
    Ok(())
}

fn check_fit(
    recording: &RecordingName,
    rename_map: &RenameMap,
    config: &PolicyConfig,
    samples: u32,
) -> Result<()> {
    let dataset = recording.open()?.renamed(rename_map)?;
    let frames = dataset.len();
    if (frames as u64) < u64::from(samples) {
        bail!("{recording} has {frames} frames, too few for a claim over {samples} samples");
    }
    refuse_unfit(config, &[dataset])
}

fn table(model: &str, estimate: &measure::Estimate) -> String {
    const GIB: f64 = (1u64 << 30) as f64;
    let memory = if estimate.fits() {
        "enough"
    } else {
        "NOT ENOUGH, so make the proof on another machine"
    };
    let argument = estimate.argument.map_or(String::new(), |argument| {
        format!(
            "\x20 argument         {time} on {cores} cores before the proof, {memory:.1} GB of memory, and {files:.1} GB of disk in the node's \
             state folder\n",
            time = duration(argument.seconds),
            cores = estimate.cores,
            memory = argument.memory_bytes as f64 / 1e9,
            files = argument.file_bytes as f64 / 1e9,
        )
    });
    format!(
        "a claim over {samples} samples of model {model}, mode {mode}\n\
         \x20 guest cycles     {cycles:.1} million ({gas:.1} million gas)\n\
         \x20 private input    {input:.1} MB, which go to the proving service{held}\n\
         {argument}\
         \x20 memory           a proof takes {needed:.0} GiB, and {free:.1} GiB are free here: {memory}\n\
         \x20 proof            {proof} on {cores} cores, and {start} once to start the service\n\
         The time follows from the cycles and from measurements on two cores (docs/prove.md, \"How long does it take?\").\n\
         After its first proof, the proving service estimates by the time that this machine took.\n",
        samples = estimate.samples,
        mode = estimate.mode,
        held = match estimate.argument {
            None => ", and hold the samples",
            Some(_) => ", and hold no sample",
        },
        cycles = estimate.cycles as f64 / 1e6,
        gas = estimate.gas as f64 / 1e6,
        input = estimate.private_input_bytes as f64 / 1e6,
        needed = estimate.memory_needed_bytes as f64 / GIB,
        free = estimate.memory_free_bytes as f64 / GIB,
        proof = duration(estimate.proving_seconds),
        cores = estimate.cores,
        start = duration(estimate.start_seconds),
    )
}

fn check_samples(mode: Mode, spec: &EvalSpec, samples: u32) -> Result<()> {
    let most = most_samples(mode, spec);
    if samples > most {
        bail!("in mode {mode} a claim about a policy of this size has at most {most} samples, and --samples is {samples}");
    }
    Ok(())
}

/// `45 s`, `10 min`, `7.3 h`, `2.1 days`.
fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 100.0 => format!("{s:.0} s"),
        s if s < 6000.0 => format!("{:.0} min", s / 60.0),
        s if s < 172_800.0 => format!("{:.1} h", s / 3600.0),
        s => format!("{:.1} days", s / 86_400.0),
    }
}
