//! The readers that get random inputs, and the inputs that fuzzing starts from.

use std::fs;
use std::path::Path;
use zk0_circuits::Digest;
use zk0_node::base_losses::BaseLosses;
use zk0_node::training_history::TrainingHistory;
use zk0_testkit::fuzzing::{Target, Targets};

pub const TARGETS: Targets = Targets {
    names: &NAMES,
    target,
    // What any input may make a reader allocate.
    slack: 2 << 20,
};

const NAMES: [&str; 2] = ["base_losses", "training_history"];

fn target(name: &str) -> Target {
    match name {
        "base_losses" => base_losses(),
        "training_history" => {
            let dir = tempfile::tempdir().unwrap();
            Target {
                seeds: vec![br#"{"round":0,"losses":[0.75,0.5]}"#.to_vec()],
                run: Box::new(move |bytes| {
                    fs::write(dir.path().join("round-0.training.json"), bytes).unwrap();
                    match TrainingHistory::read(dir.path(), 0) {
                        Ok(found) => found.map(drop).ok_or("not there".into()),
                        Err(error) => Err(without_path(&error.to_string(), dir.path())),
                    }
                }),
            }
        }
        other => panic!("no target {other}; there are {NAMES:?}"),
    }
}

fn base_losses() -> Target {
    let dir = tempfile::tempdir().unwrap();
    let (network, dataset, base) = (Digest([1; 32]), Digest([2; 32]), Digest([7; 32]));
    let losses = BaseLosses::at(dir.path(), network, dataset);
    let file = dir.path().join("base-losses.json");
    // The first file has losses to add. The second already has all losses that are asked for.
    let seeds = [2, 5].map(|last| {
        losses.up_to(last, &base, || Ok(1.0 / 3.0)).unwrap();
        fs::read(&file).unwrap()
    });
    Target {
        seeds: seeds.into(),
        run: Box::new(move |bytes| {
            fs::write(&file, bytes).unwrap();
            let read = losses.up_to(5, &base, || Ok(0.5));
            read.map(drop).map_err(|error| {
                let reported = without_path(&error.to_string(), dir.path());
                // The file may name any network, root or weights, so the outcome leaves these out.
                let quoted = [
                    "it belongs to network",
                    "whose digest is",
                    "begins with weights",
                ];
                let ends = quoted.iter().filter_map(|words| reported.find(words));
                match ends.min() {
                    Some(end) => reported[..end].to_owned(),
                    None => reported,
                }
            })
        }),
    }
}

fn without_path(message: &str, folder: &Path) -> String {
    message.replace(folder.to_str().unwrap(), "")
}
