//! Measures how much the test of a claim is worth: how often updates of different origin pass it, for several numbers of samples.
//!
//! `make power` runs the evaluation of a network on the recordings of the tests, in the profile `micro`, and prints one JSON line for
//! each base, update and number of samples. `true_change` is the relative change of the loss over all samples, each with many draws:
//! what the test tries to find out from few. An update whose true change is above `-min_improvement` did not improve, and should pass
//! at most once in a hundred times.
//!
//! The arguments are the confidence of the test (95%, 99% or 99.9%) and the files for the figure and for its data.

mod figure;
mod trials;
mod updates;

use figure::Curve;
use serde_json::json;
use std::env;
use std::fs;
use std::path::Path;
use std::time::Instant;
use trials::{share_of_passes, true_change, Models, Result};
use updates::{updates, Update};
use zk0_circuits::claim::student::Confidence;
use zk0_circuits::claim::t_test::TTest;
use zk0_circuits::model::sample::Sample;
use zk0_circuits::EvalSpec;
use zk0_lerobot::dataset::Dataset;
use zk0_node::recording::prepare_samples;
use zk0_smolvla::frames::sample::PreparedSample;
use zk0_smolvla::measure::fixed_point::quantise_sample;
use zk0_smolvla::policy::init::init_policy;
use zk0_smolvla::policy::policy_file::PolicyFile;
use zk0_smolvla::train::{train, TrainOptions};
use zk0_smolvla::Profile;

/// The recording of the node whose updates are tested.
const OWN: &str = "so100_pickplace";
/// The recordings of the other nodes. The first is another task, from which an update is stolen.
const OTHERS: [&str; 2] = ["so100_stacking", "so101_pickplace"];
/// Numbers of samples that a claim evaluates.
const SAMPLES: [u32; 7] = [4, 6, 8, 16, 32, 64, 128];
/// Challenges drawn for each update and number of samples.
const TRIALS: u32 = 1000;
/// The minimum improvement that the rules ask for by default.
const MIN_IMPROVEMENT_BPS: u32 = 100;

/// A recording, for training and for evaluating.
pub struct Prepared {
    pub samples: Vec<PreparedSample>,
    pub quantised: Vec<Sample>,
}

fn main() -> Result<()> {
    const USAGE: &str = "usage: power CONFIDENCE FIGURE.svg DATA.jsonl";
    let mut arguments = env::args().skip(1);
    let confidence: Confidence = arguments.next().ok_or(USAGE)?.parse()?;
    let (figure, data) = (
        arguments.next().ok_or(USAGE)?,
        arguments.next().ok_or(USAGE)?,
    );
    let test = TTest {
        min_improvement_bps: MIN_IMPROVEMENT_BPS,
        confidence,
    };
    let begin = Instant::now();
    let file = PolicyFile::hashing_words(init_policy(&Profile::Micro.config(), 1)?);
    let spec = EvalSpec::micro();
    let own = prepared(&file, &spec, OWN)?;
    let others = OTHERS
        .iter()
        .map(|name| prepared(&file, &spec, name))
        .collect::<Result<Vec<_>>>()?;
    let everything: Vec<PreparedSample> = [&own]
        .into_iter()
        .chain(&others)
        .flat_map(|recording| recording.samples.clone())
        .collect();
    let config = &file.policy.config;
    // The base of a network in its first round, and that of one which has learned for a while.
    let fresh = file.policy.expert.clone();
    let options = TrainOptions {
        steps: 600,
        ..updates::honest_options(0)
    };
    let learned = train(config, &fresh, &everything, &options, &mut |_| ())?.weights;
    let bases = [("fresh", fresh), ("learned", learned)];
    let mut done = 0;
    let (mut lines, mut curves) = (String::new(), Vec::new());
    for (name, base) in &bases {
        let all = updates(config, base, &own, &others[0])?;
        let count = all.len() * bases.len();
        for Update {
            origin,
            weights,
            banded,
        } in all
        {
            let models = weights
                .iter()
                .map(|update| Models::new(&spec, base, update, banded))
                .collect::<Result<Vec<_>>>()?;
            let change = true_change(&spec, &models, &own.quantised)?;
            let mut points = Vec::new();
            for n in SAMPLES {
                let share = share_of_passes(&spec, &models, &own.quantised, &test, n, TRIALS)?;
                let line = json!({
                    "bench": "power",
                    "base": name,
                    "update": origin,
                    "samples": n,
                    "passes": share.test,
                    "passes_comparison": share.comparison,
                    "true_change": change,
                    "trials": TRIALS,
                    "min_improvement_bps": test.min_improvement_bps,
                    "confidence": test.confidence.to_string(),
                });
                println!("{line}");
                lines += &format!("{line}\n");
                points.push((f64::from(n), share.test));
            }
            curves.push((
                *name,
                Curve {
                    origin,
                    true_change: change,
                    points,
                },
            ));
            done += 1;
            let left = begin.elapsed().as_secs_f64() / done as f64 * (count - done) as f64;
            eprintln!("{done} of {count} updates are tested, about {left:.0} s left");
        }
    }
    fs::write(data, lines)?;
    // The figure shows a network that has learned: in the first round, learning any task helps.
    let learned = curves.into_iter().filter(|(base, _)| *base == "learned");
    let (noise, mut shown): (Vec<_>, Vec<_>) = learned
        .map(|(_, curve)| curve)
        .partition(|curve| curve.origin.starts_with(updates::NOISE));
    shown.extend(best(&noise));
    figure::draw(
        Path::new(&figure),
        &shown,
        f64::from(MIN_IMPROVEMENT_BPS) / 10_000.0,
    )
}

/// The noise that passes most often, with what the best noise reaches for each number of samples.
fn best(noise: &[Curve]) -> Option<Curve> {
    let sum = |curve: &Curve| curve.points.iter().map(|(_, share)| share).sum::<f64>();
    let best = noise.iter().max_by(|a, b| sum(a).total_cmp(&sum(b)))?;
    let at = |index: usize| {
        let shares = noise.iter().map(|curve| curve.points[index].1);
        (best.points[index].0, shares.fold(0.0, f64::max))
    };
    Some(Curve {
        origin: format!("{}, the best of {} sizes", updates::NOISE, noise.len()),
        true_change: best.true_change,
        points: (0..best.points.len()).map(at).collect(),
    })
}

fn prepared(file: &PolicyFile, spec: &EvalSpec, name: &str) -> Result<Prepared> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/fixtures/datasets");
    let samples = prepare_samples(&Dataset::open(folder.join(name))?, file, None)?;
    let quantised = samples
        .iter()
        .map(|sample| Ok(quantise_sample(spec, sample)?));
    let quantised = quantised.collect::<Result<_>>()?;
    Ok(Prepared { samples, quantised })
}
