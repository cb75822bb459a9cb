//! The guest program and the host's code are one: same claims, same refusals, and the committed ELF is of these sources.

use sha2::{Digest, Sha256};
use std::{
    fs,
    io::{self, Write},
    path::PathBuf,
    process::Command,
};
use zk0_circuits::{spec::Dims, statement::check, EvalSpec, Witness};
use zk0_prover::{
    cycles::{self, Cost},
    execute::{ExecuteError, Executor},
    program::DIRECT_ELF,
    synthetic,
};

fn circuits() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../circuits")
}

/// Dimensions other than `micro`'s in every respect: cross-attention first to last, grouped heads, odd chunk.
const OTHER: Dims = Dims {
    expert_width: 18,
    expert_mlp: 20,
    heads: 3,
    kv_heads: 1,
    head_dim: 4,
    layers: 3,
    self_attn_every: 3,
    chunk: 5,
    max_action_dim: 7,
    action_dim: 3,
    max_prefix: 9,
};

#[tokio::test]
async fn guest_and_host_give_the_same_claim() {
    let executor = Executor::new().await.unwrap();
    let micro = EvalSpec::micro();
    let cases = (1..=6)
        .map(|seed| (&micro, 1 + seed as u32 % 4, seed))
        .collect::<Vec<_>>();
    let other = EvalSpec::new(OTHER);
    for (spec, samples, seed) in [&cases[..], &[(&other, 2, 7), (&other, 3, 8)]].concat() {
        let witness = synthetic::witness(spec, samples, seed).unwrap();
        let run = executor
            .execute(DIRECT_ELF, &witness.to_buffers())
            .await
            .unwrap();
        let claim = check(&witness).unwrap();
        assert_eq!(
            run.public_values,
            borsh::to_vec(&claim).unwrap(),
            "seed {seed}"
        );
    }
}

/// What a cheat may try on a witness that is honest otherwise.
fn cheats() -> Vec<(&'static str, fn(&mut Witness))> {
    vec![
        ("the update is the base", |w| w.update = w.base.clone()),
        ("the update is worse", |w| {
            std::mem::swap(&mut w.base, &mut w.update)
        }),
        ("more improvement than there is", |w| {
            w.header.min_improvement_bps = 9_999
        }),
        ("improvement beyond everything", |w| {
            w.header.min_improvement_bps = u32::MAX
        }),
        ("an easier sample", |w| {
            w.openings[0] = w.openings[1].clone()
        }),
        ("a sample under another's index", |w| {
            w.openings[0].sample = w.openings[1].sample.clone()
        }),
        ("samples in another order", |w| w.openings.swap(0, 1)),
        ("one sample fewer", |w| {
            w.openings.pop();
        }),
        ("more samples claimed than opened", |w| {
            w.header.eval_samples += 1
        }),
        ("another dataset", |w| w.header.dataset.root.0[0] ^= 1),
        ("a larger dataset", |w| w.header.dataset.samples += 1),
        ("another salt", |w| w.header.salt[0] ^= 1),
        ("another challenge", |w| w.header.challenge.0[31] ^= 1),
        ("scales of its own", |w| w.header.spec.layers[0].query = 200),
        ("dimensions of its own", |w| w.header.spec.dims.chunk += 1),
    ]
}

#[tokio::test]
async fn the_guest_refuses_what_the_host_refuses_for_the_same_reason() {
    let executor = Executor::new().await.unwrap();
    let honest = synthetic::witness(&EvalSpec::micro(), 2, 11).unwrap();
    for (name, cheat) in cheats() {
        let mut witness = honest.clone();
        cheat(&mut witness);
        let buffers = witness.to_buffers();
        let expected = match Witness::from_buffers(&buffers) {
            Err(error) => error.to_string(),
            Ok(witness) => check(&witness).expect_err(name).to_string(),
        };
        match executor.execute(DIRECT_ELF, &buffers).await {
            Err(ExecuteError::Refused(reason)) => assert_eq!(reason, expected, "{name}"),
            other => panic!("{name}: the guest gives {other:?}"),
        }
    }
}

#[tokio::test]
async fn the_guest_refuses_buffers_that_are_no_witness() {
    let executor = Executor::new().await.unwrap();
    let honest = synthetic::witness(&EvalSpec::micro(), 1, 12)
        .unwrap()
        .to_buffers();
    for buffer in 0..honest.len() {
        let mut longer = honest.to_vec();
        longer[buffer].extend([0; 8]);
        let mut shorter = honest.to_vec();
        let half = shorter[buffer].len() / 2;
        shorter[buffer].truncate(half);
        let mut empty = honest.to_vec();
        empty[buffer].clear();
        for (what, buffers) in [("longer", longer), ("shorter", shorter), ("empty", empty)] {
            let expected = Witness::from_buffers(&buffers).unwrap_err().to_string();
            match executor.execute(DIRECT_ELF, &buffers).await {
                Err(ExecuteError::Refused(reason)) => {
                    assert_eq!(reason, expected, "buffer {buffer} {what}")
                }
                other => panic!("buffer {buffer} {what}: the guest gives {other:?}"),
            }
        }
    }
}

/// `make cycles` prints the figures; a change that makes claims dearer shows here.
#[tokio::test]
async fn claims_do_not_get_dearer_unnoticed() {
    let committed = fs::read_to_string(circuits().join("CYCLES.json")).unwrap();
    let committed: Vec<Cost> = committed
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    let measured = cycles::measure().await.unwrap();
    assert_eq!(committed.len(), measured.len());
    for (before, now) in committed.iter().zip(&measured) {
        assert_eq!(
            (&before.profile, &before.mode, before.samples),
            (&now.profile, &now.mode, now.samples)
        );
        for (what, before, now) in [
            ("cycles", before.cycles, now.cycles),
            ("gas", before.gas, now.gas),
        ] {
            assert!(
                now * 100 <= before * 102,
                "{what} grew from {before} to {now}: more than 2 %"
            );
        }
    }
}

#[tokio::test]
async fn the_record_beside_the_elf_is_true() {
    let record = fs::read_to_string(circuits().join("elf/direct.json")).unwrap();
    let record: serde_json::Value = serde_json::from_str(&record).unwrap();
    assert_eq!(
        record["elf_sha256"],
        hex::encode(Sha256::digest(DIRECT_ELF))
    );
    let key = Executor::new()
        .await
        .unwrap()
        .verifying_key(DIRECT_ELF)
        .await
        .unwrap();
    assert_eq!(
        key.koalabear,
        zk0_circuits::program::DIRECT_VERIFYING_KEY,
        "elf/direct.vk is of another ELF: run the example record_guest"
    );
    assert_eq!(
        record["verifying_key_koalabear"],
        hex::encode(&key.koalabear)
    );
    assert_eq!(record["verifying_key_bytes32"], key.bytes32);
}

/// Skipped, and said so, only where the recorded toolchain is not installed.
#[test]
fn the_committed_elf_is_what_the_sources_give() {
    let build = Command::new(circuits().join("build-guest.sh"))
        .arg("--check")
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&build.stderr);
    match build.status.code() {
        Some(0) => {}
        // Straight to the terminal: the test harness keeps what `eprintln!` prints of tests that pass.
        Some(2) => writeln!(io::stderr(), "SKIPPED: {text}").unwrap(),
        _ => panic!("run circuits/build-guest.sh and the example record_guest\n{text}"),
    }
}
