//! A simulation against the network of the committed ledger, whose nodes trained with real proofs.

use super::{folder, prints, root, simulate};
use std::fs;
use zk0_audit::verified_entries::verified_entries;
use zk0_circuits::EvalSpec;
use zk0_ledger::Blobs;
use zk0_protocol::Body;
use zk0_weights::Format;

/// The demo's network has a third node, whose contribution was refused. Its two others trained on the recordings that are simulated. Float32
/// products are added in another order on processors with other vector instructions, so some steps of int16 are allowed.
#[test]
fn a_simulation_gives_the_weights_that_a_network_gave() {
    let ledger = root().join("tests/fixtures/ledger");
    let entries = verified_entries(&ledger).unwrap().0;
    let Body::Genesis(genesis) = &entries[0].body else {
        panic!("no genesis")
    };
    let closed = entries.iter().find_map(|entry| match &entry.body {
        Body::RoundClosed(closed) => Some(closed.clone()),
        _ => None,
    });
    let format = Format::new(&EvalSpec::decode(&genesis.evaluation).unwrap()).unwrap();
    let blobs = Blobs::at(&ledger);
    let read = |digest| format.read(&blobs.get(digest, 1 << 20).unwrap()).unwrap();
    let (start, theirs) = (
        read(&genesis.initial.blob),
        read(&closed.unwrap().global.blob),
    );

    let out = folder();
    let as_in_the_demo = ["--rounds", "1", "--steps", "800", "--learning-rate", "1e-3"];
    prints(&simulate(
        out.path(),
        &[&as_in_the_demo[..], &["--eval-frames", "1"]].concat(),
    ));
    let ours = fs::read(out.path().join("global.weights")).unwrap();
    let ours = format.read(&ours).unwrap();
    let (mut moved, mut apart) = (0.0_f64, 0.0_f64);
    for tensor in 0..format.tensors().len() {
        let values = |weights| {
            let (values, bits) = format.tensor(weights, tensor);
            let scale = (-f64::from(bits)).exp2();
            values.iter().map(move |value| f64::from(*value) * scale)
        };
        for ((start, theirs), ours) in values(&start).zip(values(&theirs)).zip(values(&ours)) {
            moved = moved.max((theirs - start).abs());
            apart = apart.max((theirs - ours).abs());
        }
    }
    println!("weights moved by up to {moved:.2e}; the simulation's differ by up to {apart:.2e}");
    assert!(apart <= 0.01 * moved, "{apart} of {moved}");
}
