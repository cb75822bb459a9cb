//! `zk0 node join --follow-losses` and `--lr-boost`: the learning rates follow the losses of the rounds' base weights. The rates
//! reach training, and are the same after a restart.

use crate::harness::network::LocalNetwork;
use serde_json::{json, Value};
use std::fs;
use std::path::Path;
use zk0_circuits::EvalSpec;
use zk0_ledger::Blobs;
use zk0_node::exchanged_weights::Base;
use zk0_smolvla::frames::batch::SamplesInMemory;
use zk0_smolvla::measure::fixed_point::dequantise_weights;
use zk0_smolvla::policy::policy_file::PolicyFile;
use zk0_smolvla::train::measured_loss::loss_of;
use zk0_smolvla::train::{train, TrainOptions, TrainingSamples};
use zk0_smolvla::PolicyConfig;
use zk0_weights::Format;

const STEPS: usize = 200;
const BATCH: usize = 16;
const MU: f64 = 0.5;
const LEARNING_RATE: f64 = 5e-4;

/// How the node trains, apart from the rates.
const TRAINING: [&str; 8] = [
    "--steps",
    "200",
    "--batch-size",
    "16",
    "--fedprox-mu",
    "0.5",
    "--learning-rate",
    "5e-4",
];

/// Returns the update that training at these rates gives, as the file of `round`.
fn trained(
    network: &LocalNetwork,
    file: &PolicyFile,
    round: u64,
    mu: f64,
    learning_rate: f64,
) -> Vec<u8> {
    let samples = network.samples(file);
    let options = TrainOptions {
        steps: STEPS,
        batch_size: BATCH,
        learning_rate,
        fedprox_mu: mu,
        seed: round,
        ..TrainOptions::default()
    };
    let (config, format, base) = base(network, file);
    let trained = train(config, &base.weights, &samples, &options, &mut |_| {});
    let update = base
        .update(&format, config, trained.unwrap().weights)
        .unwrap();
    let kept = dequantise_weights(config, format.spec(), &update).unwrap();
    kept.to_safetensors().unwrap()
}

/// The network's initial weights, as its nodes read them.
fn base<'f>(network: &LocalNetwork, file: &'f PolicyFile) -> (&'f PolicyConfig, Format, Base) {
    let genesis = network.genesis();
    let spec = EvalSpec::decode(&genesis.evaluation).unwrap();
    let (config, format) = (&file.policy.config, Format::new(&spec).unwrap());
    let blobs = Blobs::at(Path::new(&network.path("ledger")));
    let bytes = blobs.get(&genesis.initial.blob, 1 << 20).unwrap();
    let base = Base::read(&format, config, &bytes).unwrap();
    (config, format, base)
}

fn update(network: &LocalNetwork, round: u64) -> Vec<u8> {
    fs::read(network.path(&format!("state/round-{round}.safetensors"))).unwrap()
}

fn losses(network: &LocalNetwork) -> Value {
    let text = fs::read(network.path("state/base-losses.json")).unwrap();
    serde_json::from_slice(&text).unwrap()
}

#[test]
fn rates_follow_the_losses_from_start_to_start() {
    let network = LocalNetwork::new();
    network.found_with_short_rounds();
    let follow = [&TRAINING[..], &["--follow-losses"]].concat();
    // Nobody's proof is accepted, so the base weights stay and their loss stalls.
    let reported = network.joins(2, &follow);
    assert!(reported.contains("too early for a trend"), "{reported}");
    let file = network.policy();
    let samples = network.samples(&file);
    let (config, _, start) = base(&network, &file);
    let samples = SamplesInMemory::new(config, &samples).unwrap();
    let loss = loss_of(
        config,
        &start.weights,
        TrainingSamples::Prepared(&samples),
        0,
    )
    .unwrap();
    let kept = losses(&network);
    let rounds = kept["rounds"].as_array().unwrap();
    assert_eq!(rounds.len(), 2);
    for round in rounds {
        assert_eq!(round["loss"].as_f64().unwrap() as f32, loss as f32);
    }
    for round in [0, 1] {
        let expected = trained(&network, &file, round, MU, LEARNING_RATE);
        assert!(update(&network, round) == expected, "round {round}");
    }

    let reported = network.joins(1, &follow);
    assert!(
        reported.contains("stalled: mu 4.000e-1, learning rate 4.000e-4"),
        "{reported}"
    );
    let lower = trained(&network, &file, 2, MU * 0.8, LEARNING_RATE * 0.8);
    assert!(
        update(&network, 2) == lower,
        "the rates did not reach training"
    );
    assert!(lower != trained(&network, &file, 2, MU * 0.8, LEARNING_RATE));
    assert!(lower != trained(&network, &file, 2, MU, LEARNING_RATE * 0.8));

    // The file now states that the base weights were five times better until now.
    let mut past = losses(&network);
    for round in past["rounds"].as_array_mut().unwrap() {
        round["loss"] = json!(loss / 5.0);
    }
    fs::write(network.path("state/base-losses.json"), past.to_string()).unwrap();
    let boost = [&follow[..], &["--lr-boost", "1.5"]].concat();
    let reported = network.joins(1, &boost);
    assert!(
        reported.contains("diverging") && reported.contains("so the learning rate times 1.5"),
        "{reported}"
    );
    let raised = LEARNING_RATE * 0.8 * 1.1 * 1.5;
    let expected = trained(&network, &file, 3, MU * 0.8 * 1.1, raised);
    assert!(
        update(&network, 3) == expected,
        "the boost did not reach training"
    );
}

#[test]
fn nothing_is_measured_unless_it_is_wanted_and_mistakes_are_named() {
    let network = LocalNetwork::new();
    network.found_with_short_rounds();
    network.joins(1, &TRAINING);
    assert!(!Path::new(&network.path("state/base-losses.json")).exists());
    let expected = trained(&network, &network.policy(), 0, MU, LEARNING_RATE);
    assert!(update(&network, 0) == expected);

    let refused = |code, more: &[&str]| {
        let output = network.join(1, more);
        assert_eq!(output.status.code(), Some(code));
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    let boost = refused(2, &["--lr-boost", "0.5"]);
    assert!(
        boost.contains("--lr-boost <FACTOR>") && boost.contains("0.5; it must be in 1..=10"),
        "{boost}"
    );
    fs::write(network.path("state/base-losses.json"), "{").unwrap();
    let broken = refused(1, &["--follow-losses"]);
    assert!(
        broken.contains("base-losses.json is not what this node wrote there"),
        "{broken}"
    );
}
