//! Committed bytes of every hashed, signed or drawn structure. A change of any encoding or of the arithmetic shows here.
//!
//! An intended change makes a new version and a new guest program. To write the new bytes, run with `ZK0_WRITE_VECTORS=1`.

use std::path::PathBuf;
use std::{env, fs};
use zk0_circuits::claim::challenge::{challenge, sample_indices};
use zk0_circuits::claim::dataset::{leaf, salt_commitment};
use zk0_circuits::claim::statement::check;
use zk0_circuits::model::draw::draw;
use zk0_circuits::vm::digest::tagged_sha256;
use zk0_circuits::vm::merkle;
use zk0_circuits::vm::poseidon2::{hash, permute, Domain, State};
use zk0_circuits::vm::values::Values;
use zk0_circuits::{Digest, EvalSpec, Mode, NodeId};
use zk0_testkit::claims::{honest, quantise, tensors, FloatSample, Random};

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Compares `lines` (name, bytes) with the committed file.
fn compare(file: &str, lines: &[(&str, Vec<u8>)]) {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("tests/vectors")
        .join(file);
    let text: String = lines
        .iter()
        .map(|(name, bytes)| format!("{name} {}\n", hex(bytes)))
        .collect();
    if env::var_os("ZK0_WRITE_VECTORS").is_some() {
        fs::write(&path, &text).unwrap();
    }
    let committed = fs::read_to_string(&path).unwrap();
    for (line, expected) in text.lines().zip(committed.lines()) {
        assert_eq!(line, expected, "in {file}");
    }
    assert_eq!(text.lines().count(), committed.lines().count(), "in {file}");
}

fn digest(digest: Digest) -> Vec<u8> {
    digest.0.to_vec()
}

#[test]
fn sha256_structures() {
    let (network, node) = (Digest([1; 32]), NodeId([2; 32]));
    let at = challenge(&network, 3, &node, &Digest([4; 32]), &Digest([5; 32]));
    let indices = sample_indices(&at, 1000, 8).unwrap();
    let drawn = draw(&EvalSpec::micro(), &at, 1, 4);
    compare(
        "sha256.hex",
        &[
            ("tagged_empty", digest(tagged_sha256("", &[]))),
            ("tagged_tag", digest(tagged_sha256("tag", &[]))),
            (
                "tagged_parts",
                digest(tagged_sha256("tag", &[b"ab", b"", b"c"])),
            ),
            ("leaf", digest(leaf(&[7; 32], &Digest([8; 32])))),
            ("salt_commitment", digest(salt_commitment(&[7; 32]))),
            ("challenge", digest(at)),
            (
                "sample_indices",
                indices.iter().flat_map(|i| i.to_le_bytes()).collect(),
            ),
            ("draw_time", drawn.time.to_le_bytes().to_vec()),
            (
                "draw_noise",
                drawn.noise.iter().flat_map(|n| n.to_le_bytes()).collect(),
            ),
        ],
    );
}

#[test]
fn tags_and_parts_cannot_be_shifted_into_each_other() {
    let same_bytes = [
        tagged_sha256("tag", &[b"ab", b"c"]),
        tagged_sha256("tag", &[b"a", b"bc"]),
        tagged_sha256("tag", &[b"abc"]),
        tagged_sha256("tag", &[b"abc", b""]),
        tagged_sha256("taga", &[b"bc"]),
    ];
    for (index, one) in same_bytes.iter().enumerate() {
        assert!(same_bytes[..index].iter().all(|other| other != one));
    }
}

#[test]
fn poseidon2_structures() {
    let spec = EvalSpec::micro();
    let values =
        |count: i16| Values::from_slice(&(0..count).map(|i| i * 1111 - 9999).collect::<Vec<_>>());
    let pair = |index: usize| (2 * index as u64) | ((2 * index as u64 + 1) << 32);
    let mut state = State(std::array::from_fn(pair));
    permute(&mut state);
    let mut random = Random(21);
    let weights = quantise(&spec, &tensors(&spec, &mut random, 1.0));
    let sample = FloatSample::random(&spec, &mut random, 9, 1).quantise(&spec);
    compare(
        "poseidon2.hex",
        &[
            (
                "permutation_0_to_15",
                state.0.iter().flat_map(|x| x.to_le_bytes()).collect(),
            ),
            ("empty", digest(hash(Domain::Weights, &values(0)))),
            ("one_block", digest(hash(Domain::Weights, &values(12)))),
            ("thirteen", digest(hash(Domain::Weights, &values(13)))),
            ("other_domain", digest(hash(Domain::Sample, &values(13)))),
            ("weights", digest(weights.digest(Mode::Direct))),
            ("sample", digest(sample.digest())),
            ("sample_bytes", sample.as_bytes().to_vec()),
        ],
    );
}

#[test]
fn evaluation_and_claim() {
    let spec = EvalSpec::micro();
    let honest = honest(&spec, 9, 4, 77);
    let claim = check(&honest.input).unwrap();
    let [header, ..] = honest.input.to_buffers();
    compare(
        "claim.hex",
        &[
            ("spec_bytes", spec.encode()),
            ("spec_digest", digest(spec.digest())),
            ("claim_bytes", borsh::to_vec(&claim).unwrap()),
            ("private_input_header", header),
        ],
    );
}

#[test]
fn poseidon2_separates_values_lengths_and_domains() {
    let zeros = |len| hash(Domain::Weights, &Values::zeros(len));
    assert!((0..40).all(|len| (0..len).all(|other| zeros(len) != zeros(other))));
    assert_ne!(zeros(5), hash(Domain::Sample, &Values::zeros(5)));
    // Every bit of every value changes the hash, even the top bits of a word.
    let values: Vec<i16> = (0..30).map(|i| i * 1017 - 15000).collect();
    let original = hash(Domain::Weights, &Values::from_slice(&values));
    for index in 0..values.len() {
        for bit in 0..16 {
            let mut changed = values.clone();
            changed[index] ^= 1 << bit;
            assert_ne!(
                hash(Domain::Weights, &Values::from_slice(&changed)),
                original,
                "{index} {bit}"
            );
        }
    }
}

/// Leaves and roots of the test tree that Certificate Transparency implementations share.
#[test]
fn merkle_tree_is_that_of_rfc_6962() {
    let leaves: Vec<Digest> = [
        &b""[..],
        b"\x00",
        b"\x10",
        b"\x20\x21",
        b"\x30\x31",
        b"\x40\x41\x42\x43",
        b"\x50\x51\x52\x53\x54\x55\x56\x57",
        b"\x60\x61\x62\x63\x64\x65\x66\x67\x68\x69\x6a\x6b\x6c\x6d\x6e\x6f",
    ]
    .map(merkle::leaf_hash)
    .to_vec();
    for (size, root) in [
        (
            0,
            "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855",
        ),
        (
            1,
            "6e340b9cffb37a989ca544e6bb780a2c78901d3fb33738768511a30617afa01d",
        ),
        (
            2,
            "fac54203e7cc696cf0dfcb42c92a1d9dbaf70ad9e621f4bd8d98662f00e3c125",
        ),
        (
            3,
            "aeb6bcfe274b70a14fb067a5e5578264db0fa9b51af5e0ba159158f329e06e77",
        ),
        (
            8,
            "5dc9da79a70659a9ad559cb701ded9a2ab9d823aad2f4960cfe370eff4604328",
        ),
    ] {
        assert_eq!(
            merkle::root(&leaves[..size]).to_string(),
            root,
            "{size} leaves"
        );
    }
}
