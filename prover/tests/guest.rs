//! The guest program and the host's code agree: they give the same claims and the same refusals, and the committed ELF is built from
//! these sources.

use sha2::{Digest, Sha256};
use std::fs;
use std::path::PathBuf;
use std::process::Command;
use zk0_argument::claim::{self, ClaimInput};
use zk0_circuits::claim::program::{verifying_key, verifying_keys};
use zk0_circuits::claim::statement::check;
use zk0_circuits::model::spec::Dims;
use zk0_circuits::{EvalSpec, Mode, PrivateInput};
use zk0_prover::measure::cycles::{self, CycleCount};
use zk0_prover::program::{elf, elfs, synthetic, ExecuteError, Executor};
use zk0_testkit::claims::ClaimingNode;

fn circuits() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../circuits")
}

/// These dimensions differ from `micro`'s in every respect: all layers but the first have cross-attention, the heads are grouped,
/// and the chunk is odd.
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
        .map(|seed| (&micro, 2 + seed as u32 % 4, seed))
        .collect::<Vec<_>>();
    let other = EvalSpec::new(OTHER);
    for (spec, samples, seed) in [&cases[..], &[(&other, 2, 7), (&other, 3, 8)]].concat() {
        let input = synthetic::private_input(spec, Mode::Direct, samples, seed).unwrap();
        let run = executor
            .execute(elf(Mode::Direct), &input.to_buffers())
            .await
            .unwrap();
        let claim = borsh::to_vec(&check(&input).unwrap()).unwrap();
        assert_eq!(run.public_values, claim, "seed {seed}, direct");

        let committed = synthetic::private_input(spec, Mode::Succinct, samples, seed).unwrap();
        let blind = synthetic::blind(seed);
        let made = claim::make(&committed, &blind, None, &mut |_| {}).unwrap();
        let run = executor
            .execute(elf(Mode::Succinct), &made.to_buffers())
            .await
            .unwrap();
        let (shown, _) = claim::check(&made).unwrap();
        assert_eq!(shown.losses, check(&input).unwrap().losses, "seed {seed}");
        let claim = borsh::to_vec(&shown).unwrap();
        assert_eq!(run.public_values, claim, "seed {seed}, succinct");
    }
}

/// Values of the base do not fit.
#[tokio::test]
async fn guest_and_host_give_the_same_claim_about_a_base_that_saturates() {
    const NORM: &str = "model.vlm_with_expert.lm_expert.norm.weight";
    let executor = Executor::new().await.unwrap();
    let mut node = ClaimingNode::new(&EvalSpec::micro(), 20, 4, 11);
    for gain in node.base.get_mut(NORM).unwrap() {
        *gain *= 1000.0;
    }
    let direct = node.honest().input;
    let shown = check(&direct).unwrap();
    let run = executor
        .execute(elf(Mode::Direct), &direct.to_buffers())
        .await
        .unwrap();
    assert_eq!(run.public_values, borsh::to_vec(&shown).unwrap());

    let blind = synthetic::blind(11);
    let committed = node
        .honest()
        .succinct(|spec, sample| claim::committed(Mode::Succinct, spec, sample, &blind).digest);
    let made = claim::make(&committed.input, &blind, None, &mut |_| {}).unwrap();
    assert!(made.saturates);
    let run = executor
        .execute(elf(Mode::Succinct), &made.to_buffers())
        .await
        .unwrap();
    let (claim, _) = claim::check(&made).unwrap();
    assert_eq!(claim.losses, shown.losses);
    assert_eq!(run.public_values, borsh::to_vec(&claim).unwrap());
}

/// Changes that a cheat may try on an honest input.
fn cheats() -> Vec<(&'static str, fn(&mut PrivateInput))> {
    vec![
        ("the update is the base", |input| {
            input.update = input.base.clone();
            input.header.terms.update = input.header.terms.base;
        }),
        ("the update is worse", |input| {
            std::mem::swap(&mut input.base, &mut input.update);
            std::mem::swap(&mut input.header.terms.base, &mut input.header.terms.update);
        }),
        ("other weights than the header names", |input| {
            std::mem::swap(&mut input.base, &mut input.update)
        }),
        ("more improvement than there is", |input| {
            input.header.terms.test.min_improvement_bps = 9_999
        }),
        ("improvement beyond everything", |input| {
            input.header.terms.test.min_improvement_bps = u32::MAX
        }),
        ("an easier sample", |input| {
            input.openings[0] = input.openings[1].clone()
        }),
        ("a sample under another's index", |input| {
            input.openings[0].sample = input.openings[1].sample.clone()
        }),
        ("samples in another order", |input| {
            input.openings.swap(0, 1)
        }),
        ("one sample fewer", |input| {
            input.openings.pop();
        }),
        ("more samples claimed than opened", |input| {
            input.header.terms.eval_samples += 1
        }),
        ("another dataset", |input| {
            input.header.terms.dataset.root.0[0] ^= 1
        }),
        ("a larger dataset", |input| {
            input.header.terms.dataset.samples += 1
        }),
        ("another salt", |input| input.header.salt[0] ^= 1),
        ("another challenge", |input| {
            input.header.terms.challenge.0[31] ^= 1
        }),
        ("scales of its own", |input| {
            input.header.spec.layers[0].query = 200
        }),
        ("dimensions of its own", |input| {
            input.header.spec.dims.chunk += 1
        }),
    ]
}

#[tokio::test]
async fn the_guest_refuses_what_the_host_refuses_for_the_same_reason() {
    let executor = Executor::new().await.unwrap();
    let honest = synthetic::private_input(&EvalSpec::micro(), Mode::Direct, 2, 11).unwrap();
    for (name, cheat) in cheats() {
        let mut input = honest.clone();
        cheat(&mut input);
        let buffers = input.to_buffers();
        let expected = match PrivateInput::from_buffers(&buffers) {
            Err(error) => error.to_string(),
            Ok(input) => check(&input).expect_err(name).to_string(),
        };
        match executor.execute(elf(Mode::Direct), &buffers).await {
            Err(ExecuteError::Refused(reason)) => assert_eq!(reason, expected, "{name}"),
            other => panic!("{name}: the guest gives {other:?}"),
        }
    }
}

#[tokio::test]
async fn the_succinct_guest_refuses_what_the_host_refuses_for_the_same_reason() {
    type Cheat = fn(&mut ClaimInput);
    let cheats: [(&str, Cheat); 8] = [
        ("a loss", |input| input.openings[0].losses[1] -= 1),
        ("the first word", |input| input.argument.to_mut()[0] ^= 1),
        ("the last word", |input| {
            let words = input.argument.to_mut();
            *words.last_mut().unwrap() ^= 1;
        }),
        ("too few words", |input| {
            let words = input.argument.to_mut();
            words.truncate(words.len() / 2);
        }),
        ("a scale", |input| input.scales[1][0] -= 1),
        ("a base that saturates", |input| input.saturates = true),
        ("another challenge", |input| {
            input.header.terms.challenge.0[3] ^= 1
        }),
        ("another path", |input| input.openings[1].path[0].0[0] ^= 1),
    ];
    let executor = Executor::new().await.unwrap();
    let input = synthetic::private_input(&EvalSpec::micro(), Mode::Succinct, 2, 13).unwrap();
    let honest = claim::make(&input, &synthetic::blind(13), None, &mut |_| {}).unwrap();
    for (name, cheat) in cheats {
        let mut made = honest.clone();
        cheat(&mut made);
        let buffers = made.to_buffers();
        let read = ClaimInput::from_buffers(&buffers).expect(name);
        let expected = claim::check(&read).map(drop).expect_err(name).to_string();
        match executor.execute(elf(Mode::Succinct), &buffers).await {
            Err(ExecuteError::Refused(reason)) => assert_eq!(reason, expected, "{name}"),
            other => panic!("{name}: the guest gives {other:?}"),
        }
    }
}

#[tokio::test]
async fn the_guest_refuses_buffers_that_are_not_a_private_input() {
    let executor = Executor::new().await.unwrap();
    let honest = synthetic::private_input(&EvalSpec::micro(), Mode::Direct, 2, 12)
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
            let expected = PrivateInput::from_buffers(&buffers)
                .unwrap_err()
                .to_string();
            match executor.execute(elf(Mode::Direct), &buffers).await {
                Err(ExecuteError::Refused(reason)) => {
                    assert_eq!(reason, expected, "buffer {buffer} {what}")
                }
                other => panic!("buffer {buffer} {what}: the guest gives {other:?}"),
            }
        }
    }
}

/// `make cycles` prints the figures. A change that makes claims cost more fails here.
#[tokio::test]
async fn a_claim_that_costs_more_than_before_fails_the_test() {
    let committed = fs::read_to_string(circuits().join("CYCLES.json")).unwrap();
    let committed: Vec<CycleCount> = committed
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    let executor = Executor::new().await.unwrap();
    let cases = cycles::cases();
    assert_eq!(committed.len(), cases.len());
    // The argument of full size takes minutes. Another test (full_size.rs) executes the guest on a committed one.
    let quick = |case: &&cycles::Case| case.profile == "micro";
    for case in cases.iter().filter(quick) {
        let now = cycles::measure(&executor, *case).await.unwrap();
        let before = committed
            .iter()
            .find(|before| {
                (&before.profile, &before.mode, before.samples)
                    == (&now.profile, &now.mode, now.samples)
            })
            .expect("a committed figure for every case");
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
async fn the_records_beside_the_elfs_are_true() {
    let executor = Executor::new().await.unwrap();
    for mode in Mode::ALL {
        let (program, keys) = (mode.to_string(), verifying_keys(mode));
        // A program without a key or a key without a program would never be found.
        assert_eq!(elfs(mode).len(), keys.len());
        for (elf, expected) in elfs(mode).iter().zip(keys).skip(1) {
            let key = executor.verifying_key(elf).await.unwrap();
            assert_eq!(key.koalabear, **expected, "of an earlier {program}.elf");
        }
        let (elf, expected) = (elf(mode), verifying_key(mode));
        let record = fs::read_to_string(circuits().join(format!("elf/{program}.json"))).unwrap();
        let record: serde_json::Value = serde_json::from_str(&record).unwrap();
        assert_eq!(record["elf_sha256"], hex::encode(Sha256::digest(elf)));
        let key = executor.verifying_key(elf).await.unwrap();
        assert_eq!(
            key.koalabear, expected,
            "elf/{program}.vk belongs to another ELF: run the example record_guest"
        );
        assert_eq!(
            record["verifying_key_koalabear"],
            hex::encode(&key.koalabear)
        );
        assert_eq!(record["verifying_key_bytes32"], key.bytes32);
    }
}

/// Where the recorded toolchain is not installed, this test is skipped and states it.
#[test]
fn the_committed_elf_is_what_the_sources_give() {
    let build = Command::new(circuits().join("build-guest.sh"))
        .arg("--check")
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&build.stderr);
    match build.status.code() {
        Some(0) => {}
        Some(2) => zk0_testkit::skipped::skipped(text),
        _ => panic!("run circuits/build-guest.sh and the example record_guest\n{text}"),
    }
}
