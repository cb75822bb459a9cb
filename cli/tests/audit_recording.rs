//! `zk0 audit recording`: an auditor who has a node's recording and secret compares them with what the node registered. A node that is
//! started again makes no sample again.

use crate::harness::network::LocalNetwork;
use crate::harness::{copy, ends, logged, printed, prints, root, zk0, RECORDING};
use std::fs;
use std::path::{Path, PathBuf};
use zk0_ledger::Blobs;
use zk0_node::recording::secret::{RegistrationSecret, Secrets};
use zk0_protocol::entries::entry::Body;

/// The number of the entry that registered the dataset.
fn registration(network: &LocalNetwork) -> usize {
    let entries = network.entries();
    let mut found = entries.iter().enumerate();
    let found = found.find(|(_, entry)| matches!(entry.body, Body::DatasetCommitted(_)));
    found.unwrap().0
}

/// What the command prints, and states as an error, when it ends with `code`.
fn compared(
    network: &LocalNetwork,
    code: i32,
    entry: usize,
    recording: &str,
    secret: &str,
) -> String {
    let entry = entry.to_string();
    let of = [
        "--entry",
        &entry,
        "--recording",
        recording,
        "--secret",
        secret,
    ];
    compared_with(&[&network.path("ledger")], code, &of)
}

/// [`compared`], with the ledger named like this.
fn compared_with(ledger: &[&str], code: i32, of: &[&str]) -> String {
    let arguments = [&["audit", "recording", "--no-cache"], ledger, of].concat();
    let output = ends(code, zk0(&arguments));
    printed(&output) + &logged(&output)
}

#[test]
fn an_auditor_with_the_recording_finds_the_registered_samples() {
    let network = LocalNetwork::new();
    // Fewer frames are drawn than the recording has.
    network.found(&["--min-dataset-samples", "20", "--evaluation-frames", "30"]);
    network.joins(0, &[]);
    let (entry, secret) = (registration(&network), network.path("state/secret"));
    let reported = compared(&network, 0, entry, RECORDING, &secret);
    assert!(
        reported.contains("VERIFIED") && reported.contains("all 30 drawn frames"),
        "{reported}"
    );

    let other = "tests/fixtures/datasets/so100_stacking";
    let reported = compared(&network, 1, entry, other, &secret);
    assert!(
        reported.contains("FAILED")
            && reported.contains("6 registered episodes are not in the recording"),
        "{reported}"
    );
    // The node has shown the auditor other pictures than it committed to. The motion is the same, and so are the episodes.
    let changed = PathBuf::from(network.path("changed"));
    copy(&root().join(RECORDING), &changed);
    let video = |camera: &str| format!("videos/observation.images.{camera}/chunk-000/file-000.mp4");
    fs::copy(
        root().join(RECORDING).join(video("top")),
        changed.join(video("wrist")),
    )
    .unwrap();
    let reported = compared(&network, 1, entry, changed.to_str().unwrap(), &secret);
    assert!(
        reported.contains("30 of 30 drawn frames give other samples"),
        "{reported}"
    );
    assert!(reported.contains("another kind of CPU"), "{reported}");

    let forged = network.path("forged");
    let mut other = Secrets::default();
    other.add(RegistrationSecret::new([7; 32]));
    fs::write(&forged, other.encode()).unwrap();
    let reported = compared(&network, 1, entry, RECORDING, &forged);
    assert!(
        reported.contains("did not commit with a secret in"),
        "{reported}"
    );
    fs::write(&forged, &other.encode()[..70]).unwrap();
    let reported = compared(&network, 2, entry, RECORDING, &forged);
    assert!(reported.contains("its checksum is wrong"), "{reported}");
    let reported = compared(&network, 2, 0, RECORDING, &secret);
    assert!(
        reported.contains("entry 0 does not register a dataset"),
        "{reported}"
    );
    let reported = compared(&network, 2, 99, RECORDING, &secret);
    assert!(reported.contains("there is no entry 99"), "{reported}");
    let reported = compared(&network, 2, entry, "no-such-recording", &secret);
    assert!(reported.contains("there is no such folder"), "{reported}");
}

/// A damaged blob of the auditor's own copy states nothing about the ledger.
#[test]
fn a_damaged_blob_of_the_auditors_copy_is_fetched_again() {
    let network = LocalNetwork::new();
    network.found(&["--min-dataset-samples", "20", "--evaluation-frames", "30"]);
    network.joins(0, &[]);
    let (entry, secret) = (registration(&network), network.path("state/secret"));
    let (export, mirror) = (network.path("export"), network.path("mirror"));
    prints(&["ledger", "export", &network.path("ledger"), &export]);
    let number = entry.to_string();
    let of = [
        "--entry",
        &number,
        "--recording",
        RECORDING,
        "--secret",
        &secret,
    ];
    let compared = |code| compared_with(&[&export, "--mirror", &mirror], code, &of);
    let reported = compared(0);
    assert!(reported.contains("VERIFIED"), "{reported}");
    let Body::DatasetCommitted(registered) = &network.entries()[entry].body else {
        unreachable!()
    };
    let of_folder = |folder: &str| {
        let blobs = Blobs::at(Path::new(folder));
        blobs.path(&registered.statement.leaves)
    };
    let leaves = of_folder(&mirror);
    let whole = fs::read(&leaves).unwrap();
    let mut changed = whole.clone();
    changed[0] ^= 1;
    fs::write(&leaves, &changed).unwrap();
    let reported = compared(0);
    assert!(
        reported.contains("is damaged, and is fetched again"),
        "{reported}"
    );
    assert_eq!(fs::read(&leaves).unwrap(), whole);
    // Whoever serves the damaged blob is at fault.
    fs::write(&leaves, &changed).unwrap();
    fs::write(of_folder(&export), &changed).unwrap();
    let reported = compared(1);
    assert!(reported.contains("SHA-256"), "{reported}");
}

#[test]
fn a_restarted_node_keeps_its_evaluation_set() {
    let network = LocalNetwork::new();
    network.found(&["--min-dataset-samples", "20", "--evaluation-frames", "30"]);
    network.joins(0, &[]);
    let samples = || {
        let state = fs::read_dir(network.path("state")).unwrap();
        let folder = state.map(|file| file.unwrap().path()).find(|path| {
            let name = path.file_name().unwrap().to_string_lossy();
            name.starts_with("evaluation-set-")
        });
        let mut samples: Vec<_> = fs::read_dir(folder.unwrap())
            .unwrap()
            .map(|file| file.unwrap().path())
            .map(|path| (fs::metadata(&path).unwrap().modified().unwrap(), path))
            .collect();
        samples.sort();
        samples
    };
    let first = samples();
    assert_eq!(first.len(), 30);
    let before = network.entries().len();
    network.joins(0, &[]);
    assert_eq!(samples(), first, "samples were made again");
    assert_eq!(network.entries().len(), before, "it was registered again");

    // What the node has registered decides how many frames it draws, not what the rules state by now.
    let kept = network.path("state/registration");
    fs::write(&kept, b"something else").unwrap();
    let reported = logged(&network.join(0, &[]));
    assert!(
        reported.contains("registration is not what this node wrote there"),
        "{reported}"
    );
    fs::remove_file(&kept).unwrap();
    network.joins(0, &[]);
    assert!(Path::new(&kept).exists());
    assert_eq!(network.entries().len(), before);
}
