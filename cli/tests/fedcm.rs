//! `zk0 node join --fedcm-alpha`: a node takes the last global step from the ledger, and trains with it.

mod harness;

use harness::network::LocalNetwork;
use std::fs;
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};
use zk0::keys;
use zk0_circuits::{EvalSpec, Losses, NodeId, WeightsDigest};
use zk0_ledger::{Blobs, Ledger};
use zk0_node::exchanged_weights::Base;
use zk0_protocol::challenge::drawing::Drawing;
use zk0_protocol::entries::entry::{RandomnessDrawn, RoundClosed};
use zk0_protocol::entries::signed::{Submission, UpdateCommitment};
use zk0_protocol::{Body, Signed};
use zk0_smolvla::frames::batch::InMemory;
use zk0_smolvla::measure::fixed_point::dequantise_weights;
use zk0_smolvla::policy::policy_file::PolicyFile;
use zk0_smolvla::train::{train_on, FedCm, Samples, TrainOptions};
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
    let samples = InMemory::new(config, &samples).unwrap();
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
    let samples = Samples::Prepared(&samples);
    let trained = train_on(config, &base.weights, samples, &options, fedcm, &mut |_| {});
    let update = base.update(&format, config, trained.unwrap().weights);
    let kept = dequantise_weights(config, format.spec(), &update.unwrap()).unwrap();
    kept.to_safetensors().unwrap()
}

fn update(network: &LocalNetwork, round: u64) -> Vec<u8> {
    fs::read(network.path(&format!("state/round-{round}.safetensors"))).unwrap()
}

/// The operator accepts the update `result` of the node in a round of its own, without a proof, and takes it as the result. Returns the number
/// of the round.
fn accept(network: &LocalNetwork, result: WeightsDigest) -> u64 {
    let key = keys::read(Path::new(&network.path("log.key"))).unwrap();
    let node = keys::read(Path::new(&network.path("node.key"))).unwrap();
    let id = NodeId(node.verifying_key().to_bytes());
    let mut ledger = Ledger::open(Path::new(&network.path("ledger")), None, key).unwrap();
    let clock = SystemTime::now().duration_since(UNIX_EPOCH).unwrap();
    let now = clock.as_millis() as u64;
    let close = |ledger: &mut Ledger, global| {
        let round = ledger.state().round().unwrap();
        let closed = RoundClosed {
            round: round.number(),
            global,
            contributors: ledger.state().contributors(),
            unanswered: ledger.state().unanswered(),
            evaluated: None,
        };
        ledger.append(now, Body::RoundClosed(closed)).unwrap();
    };
    // The aggregator may have ended before the round of the refused update was closed, or after it opened the next one.
    if let Some(round) = ledger.state().round() {
        if !round.commits.is_empty() {
            let base = round.opened.base;
            close(&mut ledger, base);
        }
    }
    if ledger.state().round().is_none() {
        let opening = ledger.state().next_opening(now).unwrap();
        ledger.append(now, Body::RoundOpened(opening)).unwrap();
    }
    let state = ledger.state();
    let round = state.round().unwrap().number();
    let commitment = UpdateCommitment {
        network: *state.network(),
        round,
        node: id,
        dataset_root: state.node(&id).unwrap().dataset.unwrap().commitment.root,
        update: result,
        eval_samples: state.rules().min_eval_samples,
    };
    let commitment = Body::UpdateCommitted(Signed::new(commitment, &node));
    ledger.append(now, commitment).unwrap();
    let closed = ledger.state().next_commitments_closed(now).unwrap();
    ledger.append(now, Body::CommitmentsClosed(closed)).unwrap();
    let closing = ledger.state().round().unwrap().closing.unwrap();
    let drawing = Drawing::LogVrf(ledger.vrf(&closing.commitments));
    let drawn = RandomnessDrawn { round, drawing };
    ledger.append(now, Body::RandomnessDrawn(drawn)).unwrap();
    let claim = ledger.state().expected_claim(&id).unwrap();
    let claim = claim.with(Losses::Disclosed {
        before: 1000,
        after: 500,
        elements: 100,
    });
    let proof = ledger.blobs().put(b"no proof").unwrap();
    let submission = Signed::new(Submission { claim, proof }, &node);
    ledger
        .append(now, Body::ContributionAccepted(submission))
        .unwrap();
    close(&mut ledger, result);
    round
}

#[test]
fn a_node_follows_the_last_global_step_that_the_ledger_shows() {
    let network = LocalNetwork::new();
    network.found(&[]);
    let alpha = ALPHA.to_string();
    let follow = [&TRAINING[..], &["--fedcm-alpha", &alpha]].concat();
    let said = network.joins(1, &follow);
    assert!(said.contains("it is the first, so FedCM has no"), "{said}");
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
    let accepted = accept(&network, result);
    network.join(1, &follow);
    let next = accepted + 1;
    let expected = trained(&network, &file, next, &result, Some(&initial));
    assert!(
        update(&network, next) == expected,
        "the step did not reach training"
    );
    assert!(expected != trained(&network, &file, next, &result, None));

    // That round is refused, so it keeps its base.
    let said = network.joins(1, &follow);
    assert!(said.contains("the round before kept its base"), "{said}");
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
        assert_eq!(output.status.code(), Some(1));
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(
            said.contains("--fedcm-alpha: ") && said.contains("above 0"),
            "{said}"
        );
    }
}
