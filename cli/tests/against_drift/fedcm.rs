//! `zk0 node join --fedcm-alpha`: a node takes the last global step from the ledger, and trains with it.

use crate::harness::accepting::accept;
use crate::harness::network::LocalNetwork;
use std::fs;
use std::path::Path;
use zk0_circuits::{EvalSpec, WeightsDigest};
use zk0_ledger::Blobs;
use zk0_node::exchanged_weights::Base;
use zk0_protocol::Body;
use zk0_smolvla::frames::batch::SamplesInMemory;
use zk0_smolvla::measure::fixed_point::dequantise_weights;
use zk0_smolvla::policy::device::Device;
use zk0_smolvla::policy::policy_file::PolicyFile;
use zk0_smolvla::train::{train_on, FedCm, TrainOptions, TrainingSamples};
use zk0_weights::Format;

const ALPHA: f64 = 0.6;

/// How the node trains.
const TRAINING: [&str; 6] = [
    "--steps",
    "200",
    "--batch-size",
    "16",
    "--learning-rate",
    "5e-4",
];

/// The file that training from `base` gives in `round`, where the last global step came from `earlier`.
fn trained(
    network: &LocalNetwork,
    file: &PolicyFile,
    round: u64,
    base: &WeightsDigest,
    earlier: Option<&WeightsDigest>,
) -> Vec<u8> {
    let samples = network.samples(file);
    let config = &file.policy.config;
    let samples = SamplesInMemory::new(config, &samples).unwrap();
    let spec = EvalSpec::decode(&network.genesis().evaluation).unwrap();
    let format = Format::new(&spec).unwrap();
    let blobs = Blobs::at(Path::new(&network.path("ledger")));
    let read = |weights: &WeightsDigest| {
        let bytes = blobs.get(&weights.blob, 1 << 20).unwrap();
        Base::read(&format, config, &bytes).unwrap()
    };
    let options = TrainOptions {
        steps: 200,
        batch_size: 16,
        learning_rate: 5e-4,
        seed: round,
        ..TrainOptions::default()
    };
    let (base, earlier) = (read(base), earlier.map(read));
    let fedcm = earlier.as_ref().map(|earlier| FedCm {
        alpha: ALPHA,
        earlier: &earlier.weights,
    });
    let samples = TrainingSamples::Prepared(&samples);
    let (on, base_weights) = (&Device::Cpu, &base.weights);
    let trained = train_on(
        on,
        config,
        base_weights,
        samples,
        &options,
        fedcm,
        &mut |_| {},
    );
    let update = base.update(&format, config, trained.unwrap().weights);
    let kept = dequantise_weights(config, format.spec(), &update.unwrap()).unwrap();
    kept.to_safetensors().unwrap()
}

fn update(network: &LocalNetwork, round: u64) -> Vec<u8> {
    fs::read(network.path(&format!("state/round-{round}.safetensors"))).unwrap()
}

#[test]
fn a_node_follows_the_last_global_step_that_the_ledger_shows() {
    let network = LocalNetwork::new();
    network.found_with_short_rounds();
    let alpha = ALPHA.to_string();
    let follow = [&TRAINING[..], &["--fedcm-alpha", &alpha]].concat();
    let reported = network.joins(1, &follow);
    assert!(
        reported.contains("it is the first, so FedCM has no"),
        "{reported}"
    );
    let file = network.policy();
    let initial = network.genesis().initial;
    assert!(update(&network, 0) == trained(&network, &file, 0, &initial, None));

    let committed = network
        .entries()
        .into_iter()
        .find_map(|entry| match entry.body {
            Body::UpdateCommitted(signed) => Some(signed.statement.update),
            _ => None,
        });
    let result = committed.unwrap();
    let accepted = accept(&network, &[("node.key", result)], result);
    network.join(1, &follow);
    let next = accepted + 1;
    let expected = trained(&network, &file, next, &result, Some(&initial));
    assert!(
        update(&network, next) == expected,
        "the step did not reach training"
    );
    assert!(expected != trained(&network, &file, next, &result, None));

    // That round is refused, so it keeps its base.
    let reported = network.joins(1, &follow);
    assert!(
        reported.contains("the round before kept its base"),
        "{reported}"
    );
    let expected = trained(&network, &file, next + 1, &result, None);
    assert!(update(&network, next + 1) == expected);
}

#[test]
fn an_alpha_that_makes_no_sense_is_named() {
    let network = LocalNetwork::new();
    network.found(&[]);
    for alpha in ["0", "1.5", "-1"] {
        let alpha = format!("--fedcm-alpha={alpha}");
        let output = network.join(1, &[&alpha]);
        assert_eq!(output.status.code(), Some(2));
        let reported = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(
            reported.contains("--fedcm-alpha <ALPHA>") && reported.contains("above 0"),
            "{reported}"
        );
    }
}
