//! Networks of other policies than the micro profile: `zk0 aggregator init --policy` and `--profile`, and what nodes then commit
//! to.

use crate::harness::network::{committed, LocalNetwork};
use crate::harness::{ends, fails, logs, root, words, zk0, RECORDING};
use serde_json::Value;
use std::fs;
use std::path::Path;
use zk0_circuits::{Digest, EvalSpec, Mode};
use zk0_lerobot::policy_folder::PolicyFolder;
use zk0_lerobot::tokenizer::{Tokenizer, TrainedTokenizer};
use zk0_smolvla::measure::fixed_point::dims;
use zk0_smolvla::policy::init::init_policy;
use zk0_smolvla::policy::policy_file::{self, PolicyFile};
use zk0_smolvla::policy::tokenizer::PolicyTokenizer;
use zk0_smolvla::{Policy, Profile};

/// Reads the same policy without the code under test.
fn by_hand(folder: &str) -> PolicyFile {
    let policy = Policy::from_folder(&PolicyFolder::open(folder).unwrap()).unwrap();
    let tokenizer = Path::new(folder).join("tokenizer.json");
    let tokenizer = TrainedTokenizer::read(tokenizer, &policy.config).unwrap();
    PolicyFile {
        policy,
        tokenizer: tokenizer.into(),
    }
}

#[test]
fn a_network_of_a_lerobot_checkpoint_reads_instructions_with_its_tokenizer() {
    let network = LocalNetwork::new();
    let folder = network.lerobot_folder();
    let reported = network.found(&["--policy", &folder, "--mode", "succinct"]);
    assert!(reported.contains("with its own tokenizer"), "{reported}");

    let by_hand = by_hand(&folder);
    let (genesis, file) = (network.genesis(), network.policy());
    assert_eq!(file.policy, by_hand.policy);
    assert_eq!(file.tokenizer.definition(), by_hand.tokenizer.definition());
    let config = &by_hand.policy.config;
    let spec = EvalSpec::new(dims(config).unwrap());
    assert_eq!(genesis.evaluation, spec.encode());
    // The expert of this policy takes about half of it, and there is never less.
    assert_eq!(genesis.rules.max_update_bytes, 1 << 20);

    network.joins(0, &[]);
    let hashing = PolicyFile {
        tokenizer: PolicyTokenizer::word_hash(config),
        policy: by_hand.policy.clone(),
    };
    let expected = network.dataset_root(&by_hand);
    assert_eq!(committed(&network.entries()), [expected]);
    assert_ne!(network.dataset_root(&hashing), expected);
}

/// A second start finds the policy where the first one put it. A damaged file is not taken for the policy.
#[test]
fn a_node_downloads_the_policy_once_and_believes_its_digest_alone() {
    let network = LocalNetwork::new();
    network.found(&[]);
    network.joins(0, &[]);
    let kept = network.path(&format!(
        "state/policy-{}.safetensors",
        network.genesis().policy
    ));
    let modified = || fs::metadata(&kept).unwrap().modified().unwrap();
    let first = modified();
    network.joins(0, &[]);
    assert_eq!(modified(), first, "it was downloaded again");

    let good = fs::read(&kept).unwrap();
    let other = PolicyFile::hashing_words(init_policy(&Profile::Micro.config(), 9).unwrap());
    policy_file::save(&other.policy, &other.tokenizer, None, Path::new(&kept)).unwrap();
    assert_ne!(fs::read(&kept).unwrap(), good);
    network.joins(0, &[]);
    assert!(fs::read(&kept).unwrap() == good, "another policy was taken");
    // Samples prepared with another policy would give a second commitment.
    assert_eq!(committed(&network.entries()).len(), 1);
}

#[test]
fn a_node_takes_no_other_policy_than_the_genesis_names() {
    let network = LocalNetwork::new();
    network.found(&[]);
    let name = network.genesis().policy.to_string();
    let blob = Path::new(&network.path("ledger/blobs/sha256")).join(&name);
    let other = PolicyFile::hashing_words(init_policy(&Profile::Micro.config(), 9).unwrap());
    policy_file::save(&other.policy, &other.tokenizer, None, &blob).unwrap();
    let output = network.join(0, &[]);
    let reported = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{reported}");
    assert!(
        reported.contains(&format!("blob {name} has SHA-256 ")),
        "{reported}"
    );
    let kept = network.path(&format!("state/policy-{name}.safetensors"));
    assert!(!Path::new(&kept).exists());
}

/// The founder chooses ranges from samples as the nodes will make them.
#[test]
fn calibration_reads_instructions_with_the_policy_s_tokenizer() {
    let network = LocalNetwork::new();
    let folder = network.lerobot_folder();
    let calibrate = [
        "--policy",
        &folder,
        "--mode",
        "succinct",
        "--calibrate",
        RECORDING,
    ];
    let file = Path::new(&folder).join("tokenizer.json");
    let good = fs::read_to_string(&file).unwrap();
    // The tokenizer gives each unknown word a token that the policy does not know.
    fs::write(&file, good.replace("\"?\":0", "\"?\":500")).unwrap();
    let refused = fails(&words(&network.founding(&calibrate)));
    assert!(refused.contains("token id 500"), "{refused}");
    assert!(!Path::new(&network.path("ledger")).exists());
    fs::write(&file, good).unwrap();
    network.found(&calibrate);
    let config = &network.policy().policy.config;
    let default = EvalSpec::new(dims(config).unwrap());
    let chosen = EvalSpec::decode(&network.genesis().evaluation).unwrap();
    assert_eq!(chosen.dims, default.dims);
    assert_ne!(chosen, default);
}

#[test]
fn without_a_policy_it_is_micro_and_a_file_is_as_good_as_what_it_was_made_of() {
    let micro = LocalNetwork::new();
    micro.found(&[]);
    let genesis = micro.genesis();
    assert_eq!(genesis.evaluation, EvalSpec::micro().encode());
    let file = micro.policy();
    assert_eq!(
        file.policy,
        init_policy(&Profile::Micro.config(), 0).unwrap()
    );
    assert_eq!(file.tokenizer.definition(), None);

    // This network is founded on the policy file of the other one, so the bytes are the same.
    let again = LocalNetwork::new();
    let blobs = micro.path("ledger/blobs/sha256");
    let blob = Path::new(&blobs).join(genesis.policy.to_string());
    again.found(&["--policy", blob.to_str().unwrap()]);
    let copy = again.genesis();
    assert_eq!(
        (copy.policy, copy.initial),
        (genesis.policy, genesis.initial)
    );

    let other = LocalNetwork::new();
    other.found(&["--profile", "micro", "--seed", "1"]);
    assert_ne!(other.genesis().policy, genesis.policy);
}

#[test]
fn an_update_has_room_in_the_rules_or_nothing_is_founded() {
    let network = LocalNetwork::new();
    let rules: Value =
        serde_json::from_slice(&ends(0, zk0(&["aggregator", "rules"])).stdout).unwrap();
    let found = |limit: u64, more: &[&str]| {
        let mut rules = rules.clone();
        rules["max_update_bytes"] = limit.into();
        let file = network.path("rules.json");
        fs::write(&file, rules.to_string()).unwrap();
        network.founding(&[&["--rules", &file], more].concat())
    };
    let tiny = ["--profile", "tiny", "--mode", "succinct"];
    let reported = fails(&words(&found(300_000, &tiny)));
    assert!(
        reported.contains("rule max_update_bytes in ")
            && reported.contains("is 300000, too little"),
        "{reported}"
    );
    let needed = reported.rsplit("write ").next().unwrap();
    let needed: u64 = needed.split(' ').next().unwrap().parse().unwrap();
    let too_little = fails(&words(&found(needed - 1, &tiny)));
    assert!(too_little.contains("too little"), "{too_little}");
    assert!(!Path::new(&network.path("ledger")).exists());
    logs(&words(&found(needed, &tiny)));
    assert_eq!(network.genesis().rules.max_update_bytes, needed);
}

#[test]
fn nothing_is_added_to_a_folder_that_holds_a_ledger() {
    let network = LocalNetwork::new();
    network.found(&[]);
    let blobs = || {
        fs::read_dir(network.path("ledger/blobs/sha256"))
            .unwrap()
            .count()
    };
    assert_eq!(blobs(), 2);
    let refused = fails(&words(&network.founding(&["--seed", "5"])));
    let ledger = network.path("ledger");
    let reports = format!(
        "{ledger} already holds a ledger: `zk0 aggregator serve {ledger} --key FILE` continues its network"
    );
    assert!(refused.contains(&reports), "{refused}");
    assert_eq!(blobs(), 2);
}

#[test]
fn mode_direct_is_for_small_policies() {
    let network = LocalNetwork::new();
    let tiny = |more: &[&str]| network.founding(&[&["--profile", "tiny"], more].concat());
    let direct = ["--mode", "direct"];
    let many = ["--min-eval-samples", "100", "--min-dataset-samples", "100"];
    let refused = fails(&words(&tiny(&[&direct[..], &many].concat())));
    assert!(
        refused.contains("100 samples a claim takes more than 1")
            && refused.contains("add --mode succinct"),
        "{refused}"
    );
    assert!(!Path::new(&network.path("ledger")).exists());
    let warned = logs(&words(&tiny(&direct)));
    assert!(warned.contains("--mode succinct takes fewer"), "{warned}");
}

#[test]
fn the_best_mode_is_chosen_by_the_size_of_the_policy() {
    for (profile, mode) in [("micro", Mode::Direct), ("tiny", Mode::Succinct)] {
        let network = LocalNetwork::new();
        let reported = logs(&words(&network.founding(&["--profile", profile])));
        assert!(
            reported.contains(&format!("proven in mode {mode}")),
            "{reported}"
        );
        assert_eq!(network.genesis().mode, mode);
    }
    let network = LocalNetwork::new();
    network.found(&["--mode", "succinct"]);
    assert_eq!(network.genesis().mode, Mode::Succinct);
}

#[test]
fn a_policy_that_cannot_be_used_founds_nothing() {
    let network = LocalNetwork::new();
    let folder = network.lerobot_folder();
    let refused = |more: &[&str]| {
        let reported = fails(&words(&network.founding(more)));
        assert!(!Path::new(&network.path("ledger")).exists(), "{reported}");
        reported
    };
    let nowhere = refused(&["--policy", "no/such/policy"]);
    assert!(nowhere.contains("no/such/policy"), "{nowhere}");
    fs::write(Path::new(&folder).join("tokenizer.json"), "{}").unwrap();
    let broken = refused(&["--policy", &folder, "--mode", "succinct"]);
    assert!(
        broken.contains("tokenizer.json: is not a tokenizer.json"),
        "{broken}"
    );
    let both = network.founding(&["--policy", &folder, "--seed", "1"]);
    ends(2, zk0(&words(&both)));
}

/// A network can begin with a policy that its founder trained, and the policy keeps its tokenizer.
#[test]
fn a_trained_policy_keeps_its_tokenizer() {
    let network = LocalNetwork::new();
    let folder = network.lerobot_folder();
    let out = network.path("run");
    let cache = network.path("cache");
    logs(&[
        "train",
        "--dataset",
        RECORDING,
        "--policy",
        &folder,
        "--steps",
        "2",
        "--out",
        &out,
        "--cache",
        &cache,
    ]);
    let model = network.path("run/model.safetensors");
    let file = policy_file::load(Path::new(&model)).unwrap();
    let text = "Pick up the red cube";
    assert_eq!(file.tokenizer.tokens(text).unwrap(), [11, 12, 13, 14, 15]);
    network.found(&["--policy", &model, "--mode", "succinct"]);
    let founded = network.policy();
    assert_eq!(founded.policy, file.policy);
    assert_eq!(founded.tokenizer.definition(), file.tokenizer.definition());
}

/// Ledgers hold digests of policies without a tokenizer, so the bytes of such files never change.
#[test]
fn the_committed_ledger_s_policy_is_written_byte_for_byte() {
    let ledger = root().join("tests/fixtures/ledger");
    let (entries, _) = zk0_audit::verified_entries::verified_entries(&ledger).unwrap();
    let zk0_protocol::entries::entry::Body::Genesis(genesis) = &entries[0].body else {
        panic!("no genesis");
    };
    let blob = ledger.join("blobs/sha256").join(genesis.policy.to_string());
    let file = policy_file::load(&blob).unwrap();
    let mut written = Vec::new();
    let digest = file.write(&mut written).unwrap().digest;
    assert!(written == fs::read(&blob).unwrap());
    assert_eq!(Digest(digest), genesis.policy);
}
