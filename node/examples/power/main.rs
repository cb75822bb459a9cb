//! Measures how much the test of a claim is worth: how often updates of different origin pass it, for several numbers of samples.
//!
//! `make power` runs the evaluation of a network on the recordings of the tests, in the profile `micro`, and prints one JSON line for
//! each base, update and number of samples. `true_change` is the relative change of the loss over all samples, each with many draws:
//! what the test tries to find out from few. An update whose true change is above `-min_improvement` did not improve, and should pass
//! at most once in a hundred times.

mod trials;
mod updates;

use serde_json::json;
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
const SAMPLES: [u32; 6] = [4, 8, 16, 32, 64, 128];
/// Challenges drawn for each update and number of samples.
const TRIALS: u32 = 1000;
/// The test that the rules ask for by default.
const TEST: TTest = TTest {
    min_improvement_bps: 100,
    confidence: Confidence::P99,
};

/// A recording, for training and for evaluating.
pub struct Prepared {
    pub samples: Vec<PreparedSample>,
    pub quantised: Vec<Sample>,
}

fn main() -> Result<()> {
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
    for (name, base) in &bases {
        let all = updates(config, base, &own, &others[0])?;
        let count = all.len() * bases.len();
        for Update { origin, weights } in all {
            let models = weights
                .iter()
                .map(|update| Models::new(&spec, base, update))
                .collect::<Result<Vec<_>>>()?;
            let change = true_change(&spec, &models, &own.quantised)?;
            for n in SAMPLES {
                let share = share_of_passes(&spec, &models, &own.quantised, &TEST, n, TRIALS)?;
                let line = json!({
                    "bench": "power",
                    "base": name,
                    "update": origin,
                    "samples": n,
                    "passes": share.test,
                    "passes_comparison": share.comparison,
                    "true_change": change,
                    "trials": TRIALS,
                    "min_improvement_bps": TEST.min_improvement_bps,
                    "confidence": TEST.confidence.to_string(),
                });
                println!("{line}");
            }
            done += 1;
            let left = begin.elapsed().as_secs_f64() / done as f64 * (count - done) as f64;
            eprintln!("{done} of {count} updates are tested, about {left:.0} s left");
        }
    }
    Ok(())
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
