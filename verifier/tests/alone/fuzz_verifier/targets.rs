//! The readers that get random inputs, and the inputs that fuzzing starts from.

use std::collections::HashMap;
use std::path::Path;

use sp1_hypercube::{create_dummy_recursion_proof, SP1VerifyingKey};
use sp1_verifier::SP1Proof;
use zk0_argument::expert::published::digest;
use zk0_circuits::model::eval::Evaluator;
use zk0_circuits::model::layout::expert_tensors;
use zk0_circuits::model::spec::Dims;
use zk0_circuits::{Claim, EvalSpec, Mode, QuantisedWeights};
use zk0_ledger::{replay, Blobs, Finding, Recheck};
use zk0_protocol::entries::signed::{Signed, Submission};
use zk0_protocol::{Body, Entry, Refusal, RefusalCode, State};
use zk0_testkit::fuzzing::{Target, Targets};
use zk0_testkit::weight_claims::left;
use zk0_verifier::{check_proof, check_weight_claims, Evaluation, ProgramKey};
use zk0_weights::Format;

pub const TARGETS: Targets = Targets {
    names: &NAMES,
    target,
    // A whole proof is made of the changes to it, and serde makes room for a mebibyte of any list before it finds that there is less.
    slack: 8 << 20,
};

const NAMES: [&str; 6] = [
    "eval_spec",
    "program_key",
    "proof",
    "changed_proof",
    "expert_tensors",
    "weight_claims",
];

fn target(name: &str) -> Target {
    match name {
        "eval_spec" => Target {
            seeds: [EvalSpec::micro(), EvalSpec::new(Dims::FULL)]
                .map(|spec| spec.encode())
                .into(),
            run: Box::new(|bytes| {
                let spec = EvalSpec::decode(bytes).map_err(text)?;
                assert_eq!(spec.encode(), bytes, "a second encoding");
                // Readers of a genesis with this specification do the following.
                Evaluator::new(&spec).map(drop).map_err(text)?;
                Evaluation::new(&spec, Mode::Succinct)
                    .map(drop)
                    .map_err(text)
            }),
        },
        "program_key" => Target {
            seeds: vec![
                vec![0; 32],
                [0x7f00_0000u32; 8].map(u32::to_le_bytes).concat(),
            ],
            run: Box::new(|bytes| ProgramKey::from_bytes(bytes).map(drop).map_err(text)),
        },
        "proof" => proof(),
        "changed_proof" => changed_proof(),
        "expert_tensors" => {
            let format = Format::new(&EvalSpec::micro()).unwrap();
            Target {
                seeds: vec![format.write(&weights(format.spec()))],
                run: Box::new(move |bytes| {
                    let weights = format.read(bytes).map_err(text)?;
                    assert_eq!(format.write(&weights), bytes, "a second file");
                    Ok(())
                }),
            }
        }
        "weight_claims" => weight_claims(),
        other => panic!("no target {other}; there are {NAMES:?}"),
    }
}

fn text(error: impl ToString) -> String {
    error.to_string()
}

/// An accepted contribution of a real network: its claim, the program's key and the proof.
#[derive(Default)]
struct Accepted(Option<(Claim, ProgramKey, Vec<u8>)>);

impl Recheck for Accepted {
    fn entry(&mut self, before: &State, _: u64, entry: &Entry, blobs: &Blobs) -> Vec<Finding> {
        if let Body::ContributionAccepted(Signed { statement, .. }) = &entry.body {
            let Submission { claim, proof } = statement;
            let key = ProgramKey::from_bytes(&before.genesis().program).unwrap();
            self.0 = Some((claim.clone(), key, blobs.get(proof, 4 << 20).unwrap()));
        }
        Vec::new()
    }
}

fn accepted() -> (Claim, ProgramKey, Vec<u8>) {
    let dir = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/fixtures/ledger");
    let mut accepted = Accepted::default();
    replay(&dir, None, &mut accepted);
    accepted
        .0
        .expect("the fixture has an accepted contribution")
}

/// Reads a proof's own bytes. The seed comes from SP1's mock prover. It is small and whole, and proves nothing. The expected
/// refusal of it counts as read.
fn proof() -> Target {
    let (claim, key, _) = accepted();
    let mock: SP1VerifyingKey = bincode::deserialize(&[0; 4096]).unwrap();
    let mock = SP1Proof::Compressed(Box::new(create_dummy_recursion_proof(&mock)));
    let mock = bincode::serialize(&mock).unwrap();
    let wanted = check_proof(&mock, &claim, &key).unwrap_err();
    assert_eq!(wanted.code, RefusalCode::InvalidProof, "{wanted}");
    Target {
        seeds: vec![mock],
        run: Box::new(move |bytes| match check_proof(bytes, &claim, &key) {
            Err(refusal) if refusal == wanted => Ok(()),
            other => other.map_err(text),
        }),
    }
}

/// Changes a real proof, which is too large to be mutated and kept itself. Each change has nine bytes: what is done, where, and
/// with which number.
fn changed_proof() -> Target {
    let (claim, key, good) = accepted();
    // The first call builds the verifier itself.
    check_proof(&good, &claim, &key).unwrap();
    let nothing = |at: u32| [&[0][..], &at.to_le_bytes(), &[0; 4]].concat();
    let spread = (0..8u32).flat_map(|n| nothing(n * good.len() as u32 / 8));
    Target {
        seeds: vec![nothing(0), spread.collect()],
        run: Box::new(move |bytes| {
            let mut proof = good.clone();
            for change in bytes.chunks_exact(9) {
                let at = u32::from_le_bytes([change[1], change[2], change[3], change[4]]);
                let at = at as usize % proof.len().max(1);
                let number = &change[5..];
                match change[0] % 4 {
                    0 | 1 => proof[at..]
                        .iter_mut()
                        .zip(number)
                        .for_each(|(b, n)| *b ^= n),
                    2 => proof[at..]
                        .iter_mut()
                        .zip(number)
                        .for_each(|(b, n)| *b = *n),
                    _ => proof.truncate(at.max(1)),
                }
            }
            check_proof(&proof, &claim, &key).map_err(text)
        }),
    }
}

fn weights(spec: &EvalSpec) -> QuantisedWeights {
    let value = |at: usize| (at * 37 % 101) as f32 / 250.0 - 0.2;
    let tensors: HashMap<String, Vec<f32>> = expert_tensors(&spec.dims)
        .into_iter()
        .map(|tensor| {
            let len = tensor.len();
            (tensor.name, (0..len).map(value).collect())
        })
        .collect();
    QuantisedWeights::quantise(spec, |name| tensors.get(name).map(Vec::as_slice)).unwrap()
}

/// Reads what a proof left to check of the weights. The digest by the proof is taken from the bytes themselves, so that everything behind the
/// comparison of digests is reached, too.
fn weight_claims() -> Target {
    let format = Format::new(&EvalSpec::micro()).unwrap();
    let good = weights(format.spec());
    let (seed, _) = left([&good, &good], 1);
    let file = format.write(&good);
    let scales = [(); 2].map(|()| format.open(&file[..]).unwrap().scales().to_vec());
    Target {
        seeds: vec![seed],
        run: Box::new(move |bytes| {
            let words = bytes.as_chunks::<8>().0.iter();
            let words: Vec<u64> = words.map(|word| u64::from_le_bytes(*word)).collect();
            let claimed = digest(&scales, &words);
            check_weight_claims(&format, &claimed, bytes, &file[..], &file[..])
                .map_err(without_digests)
        }),
    }
}

/// Returns one outcome for all digests.
fn without_digests(refusal: Refusal) -> String {
    match refusal.code {
        RefusalCode::OtherWeightCheck { .. } => "other weight check".into(),
        _ => refusal.to_string(),
    }
}
