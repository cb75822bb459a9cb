//! The committed proof of a claim at SmolVLA's published size, which `make prove-full` made: 98 M weights, 177 prefix tokens, 50 actions, 4 samples. It is
//! verified as an aggregator or an auditor verifies it, with the weights made again from their seed.

use std::fs;
use std::path::PathBuf;
use zk0_circuits::claim::program::verifying_key;
use zk0_circuits::model::layout::expert_tensors;
use zk0_circuits::model::spec::Dims;
use zk0_circuits::{Claim, EvalSpec, Losses, Mode, QuantisedWeights};
use zk0_protocol::{Refusal, RefusalCode};
use zk0_prover::measure::cycles::CycleCount;
use zk0_prover::program::synthetic::weights_tried;
use zk0_prover::program::{elf, Executor};
use zk0_verifier::{check_proof, check_weight_claims, ProgramKey};
use zk0_weights::Format;

/// The samples and the seed of `make prove-full`.
const SAMPLES: u32 = 4;
const SEED: u64 = 1;

fn read(name: &str) -> Vec<u8> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/fixtures/full_size");
    fs::read(folder.join(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
}

fn claim() -> Claim {
    borsh::from_slice(&read("claim.bin")).unwrap()
}

#[test]
fn the_proof_of_a_claim_at_the_published_size_verifies() {
    let (claim, proof) = (claim(), read("proof.bin"));
    let key = ProgramKey::from_bytes(verifying_key(Mode::Succinct)).unwrap();
    assert_eq!(check_proof(&proof, &claim, &key), Ok(()));

    let spec = EvalSpec::new(Dims::FULL);
    let weights: usize = expert_tensors(&spec.dims).iter().map(|t| t.len()).sum();
    assert_eq!(weights, 99_849_312);
    assert_eq!(claim.terms.evaluation, spec.digest());
    assert_eq!(claim.terms.eval_samples, SAMPLES);
    let Losses::Disclosed { before, after, .. } = claim.losses else {
        panic!("the claim discloses its losses");
    };
    assert!(after < before);

    // The same proof is refused for any other claim, and so is another proof.
    let mut other = claim.clone();
    other.terms.update.quantised.0[0] ^= 1;
    let refused = check_proof(&proof, &other, &key);
    assert_eq!(refused, Err(RefusalCode::OtherClaim.into()));
    let mut changed = proof;
    let middle = changed.len() / 2;
    changed[middle] ^= 1;
    assert!(check_proof(&changed, &claim, &key).is_err());
}

/// The argument about the four samples is committed too, so that a guest program that takes more cycles for it is noticed within a second.
#[tokio::test]
async fn the_guest_takes_as_many_cycles_as_recorded() {
    let buffers: Vec<Vec<u8>> = borsh::from_slice(&read("input.bin")).unwrap();
    let executor = Executor::new().await.unwrap();
    let run = executor
        .execute(elf(Mode::Succinct), &buffers)
        .await
        .unwrap();
    assert_eq!(run.public_values, read("claim.bin"));
    let recorded = include_str!("../../circuits/CYCLES.json").lines();
    let mut recorded = recorded.map(|line| serde_json::from_str::<CycleCount>(line).unwrap());
    let recorded = recorded.find(|cost| cost.profile == "full" && cost.samples == SAMPLES);
    let recorded = recorded.expect("a line for the full size");
    for (what, before, now) in [
        ("cycles", recorded.cycles, run.cycles),
        ("gas", recorded.gas, run.gas),
    ] {
        assert!(
            now * 100 <= before * 102,
            "{what} grew from {before} to {now}: more than 2 %"
        );
    }
}

/// The weights in the claim are those that follow from the seed, and what the proof left to check of them holds.
#[test]
fn the_weights_that_were_proven_are_those_of_the_seed() {
    let claim = claim();
    let spec = EvalSpec::new(Dims::FULL);
    let named = |[base, update]: &[QuantisedWeights; 2]| {
        let terms = &claim.terms;
        update.digest(Mode::Succinct) == terms.update.quantised
            && base.digest(Mode::Succinct) == terms.base.quantised
    };
    let mut tried = weights_tried(&spec, SAMPLES, SEED).map(Result::unwrap);
    let weights = tried.find(named).expect("the weights of the claim");
    let format = Format::new(&spec).unwrap();
    let [base, mut update] = weights.map(|weights| format.write(&weights));
    let (left, claimed) = (read("weight_check.bin"), claim.weight_check.unwrap());
    let told = |update: &[u8]| check_weight_claims(&format, &claimed, &left, &base[..], update);
    assert_eq!(told(&update), Ok(()));
    // One weight differs by the least that it can.
    let middle = update.len() / 2;
    update[middle - middle % 2] ^= 1;
    assert!(matches!(
        told(&update),
        Err(Refusal {
            code: RefusalCode::OtherModels,
            ..
        })
    ));
}
