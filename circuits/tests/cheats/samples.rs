//! Cheats that open other samples than those drawn, or commit to other data than they say.

use super::verifier::{improves, loss, loss_at, prove};
use crate::claims::{nudged, Node, Parts, Random, SALT};
use zk0_circuits::claim::challenge::sample_indices;
use zk0_circuits::claim::dataset::{check_leaves, leaf, salt_commitment};
use zk0_circuits::claim::private_input::Opening;
use zk0_circuits::vm::digest::tagged_sha256;
use zk0_circuits::vm::merkle;
use zk0_circuits::{Digest, EvalSpec, Sample};

/// A node with `samples` samples of which `count` are drawn.
fn node(samples: usize, count: u32) -> Node {
    Node::new(&EvalSpec::micro(), samples, count, 11)
}

/// Opens sample `index` by its path.
fn open(dataset: &[Sample], leaves: &[Digest], index: usize) -> Opening {
    Opening {
        index: index as u64,
        sample: dataset[index].clone(),
        path: merkle::path(leaves, index).unwrap(),
    }
}

/// Gives the node an update that lowers the loss on `some` (sample, position), and raises it on all samples drawn.
fn help_only(node: &mut Node, some: &[(&Parts, usize)], drawn: &[&Parts]) {
    let on_some = |node: &Node, tensors: &_| -> f64 {
        let losses = some.iter();
        losses
            .map(|&(parts, position)| loss_at(node, tensors, parts, position))
            .sum()
    };
    for seed in 0..1000 {
        node.update = nudged(&node.base, &mut Random(seed), 0.3);
        let lower = on_some(node, &node.update) < 0.95 * on_some(node, &node.base);
        let higher = loss(node, &node.update, drawn) > 1.02 * loss(node, &node.base, drawn);
        if lower && higher {
            assert!(!improves(node, drawn));
            return;
        }
    }
    panic!("no update helps only these samples");
}

/// The update helps on the first sample drawn, and harms on all four.
pub fn fewer() -> Result<(), String> {
    let mut node = node(6, 4);
    let data = node.data.clone();
    let drawn = sample_indices(&node.challenge, 6, 4).unwrap();
    let drawn: Vec<&Parts> = drawn.iter().map(|&index| &data[index as usize]).collect();
    help_only(&mut node, &[(drawn[0], 0)], &drawn);
    let mut input = node.honest().input;
    input.openings.truncate(1);
    prove(input).map(drop)
}

/// The update helps on another sample than the one drawn.
pub fn lucky() -> Result<(), String> {
    let mut node = node(6, 1);
    let drawn = sample_indices(&node.challenge, 6, 1).unwrap()[0] as usize;
    let lucky = (drawn + 1) % 6;
    let data = node.data.clone();
    help_only(&mut node, &[(&data[lucky], 0)], &[&data[drawn]]);
    let honest = node.honest();
    let mut input = honest.input;
    input.openings = vec![open(&honest.dataset, &honest.leaves, lucky)];
    prove(input).map(drop)
}

/// The update helps on a sample that is not in the dataset, put in the place of the one drawn.
pub fn invented() -> Result<(), String> {
    let mut node = node(6, 1);
    let drawn = sample_indices(&node.challenge, 6, 1).unwrap()[0] as usize;
    let invented = Parts::random(&node.spec, &mut Random(8), 9, 0);
    let data = node.data.clone();
    help_only(&mut node, &[(&invented, 0)], &[&data[drawn]]);
    let mut input = node.honest().input;
    input.openings[0].sample = invented.quantise(&node.spec);
    prove(input).map(drop)
}

/// The update helps on one of two samples. The node waits for a challenge that hits this one twice before it hits the other.
pub fn twice() -> Result<(), String> {
    let mut node = node(2, 2);
    // The first bit of each of a block's four little-endian words says which of the two samples is drawn.
    let hits = |challenge: &Digest| {
        let block = tagged_sha256("zk0/indices/v1", &[&challenge.0, &0u64.to_le_bytes()]);
        [7, 15].map(|byte: usize| block.0[byte] as usize >> 7)
    };
    let mut challenges = (0..).map(|round| Digest([round; 32]));
    node.challenge = challenges
        .find(|challenge| hits(challenge) == [0, 0])
        .unwrap();
    let data = node.data.clone();
    let some = [(&data[0], 0), (&data[0], 1)];
    help_only(&mut node, &some, &[&data[0], &data[1]]);
    let honest = node.honest();
    let mut input = honest.input;
    input.openings = vec![open(&honest.dataset, &honest.leaves, 0); 2];
    prove(input).map(drop)
}

/// The dataset counts two samples. Two more lie below the place of the second, so index 0 also leads to the first of them, by a
/// path that is too long. The update helps on that sample.
pub fn deeper() -> Result<(), String> {
    let mut node = node(3, 1);
    let first_of_two = |challenge: &Digest| sample_indices(challenge, 2, 1).unwrap() == [0];
    let mut challenges = (0..).map(|round| Digest([round; 32]));
    node.challenge = challenges.find(first_of_two).unwrap();
    let data = node.data.clone();
    help_only(&mut node, &[(&data[1], 0)], &[&data[0]]);
    let honest = node.honest();
    let leaves = honest.leaves;
    let mut input = honest.input;
    let dataset = &mut input.header.terms.dataset;
    let below = merkle::node_hash(&leaves[1], &leaves[2]);
    dataset.root = merkle::node_hash(&leaves[0], &below);
    dataset.samples = 2;
    input.openings = vec![Opening {
        index: 0,
        sample: honest.dataset[1].clone(),
        path: vec![leaves[2], leaves[0]],
    }];
    prove(input).map(drop)
}

/// The node has only one sample. The dataset counts six, and whichever index is drawn leads to that sample.
pub fn shallower() -> Result<(), String> {
    let node = node(1, 1);
    let honest = node.honest();
    let mut input = honest.input;
    input.header.terms.dataset.samples = 6;
    input.header.terms.eval_samples = 4;
    let drawn = sample_indices(&node.challenge, 6, 4).unwrap();
    let opening = input.openings[0].clone();
    input.openings = vec![opening; 4];
    for (opening, drawn) in input.openings.iter_mut().zip(drawn) {
        opening.index = drawn;
    }
    let claim = prove(input)?;
    assert!(merkle::root(&honest.leaves) == claim.terms.dataset.root && honest.leaves.len() == 1);
    Ok(())
}

/// A dataset of six samples that are all the same, though its leaves differ: by their salts, or by what `copy` makes of them.
fn copies(
    salts: [[u8; 32]; 6],
    copy: impl Fn(&Sample, usize) -> Result<Sample, String>,
) -> Result<(), String> {
    let node = node(3, 1);
    let one = node.data[2].clone();
    let node = Node {
        data: vec![one; 6],
        ..node
    };
    let honest = node.honest();
    let mut input = honest.input;
    let dataset: Vec<Sample> = honest
        .dataset
        .iter()
        .enumerate()
        .map(|(index, sample)| copy(sample, index))
        .collect::<Result<_, _>>()?;
    let leaves: Vec<Digest> = dataset
        .iter()
        .zip(&salts)
        .map(|(sample, salt)| leaf(salt, &sample.digest()))
        .collect();
    input.header.terms.dataset.root = merkle::root(&leaves);
    input.header.terms.dataset.salt_commitment = salt_commitment(&salts[0]);
    let drawn = input.openings[0].index as usize;
    assert_ne!(drawn, 0, "the sample drawn has the first salt");
    input.openings = vec![open(&dataset, &leaves, drawn)];
    input.header.salt = salts[drawn];
    let claim = prove(input)?;
    // A verifier who holds the list of leaves sees no duplicate.
    assert_eq!(check_leaves(&claim.terms.dataset, &leaves), Ok(()));
    Ok(())
}

/// Gives each copy a salt of its own.
pub fn salted_copies() -> Result<(), String> {
    let salts = [0, 1, 2, 3, 4, 5].map(|index| [index; 32]);
    copies(salts, |sample, _| Ok(sample.clone()))
}

/// Marks the last frame of each copy, which is padding, with another number.
pub fn flagged_copies() -> Result<(), String> {
    let chunk = EvalSpec::micro().dims.chunk as usize;
    copies([SALT; 6], |sample, index| {
        with_value(sample, chunk, 1 + index as i16)
    })
}

/// Puts another number behind the last value of each copy. Nothing reads it.
pub fn padded_copies() -> Result<(), String> {
    copies([SALT; 6], |sample, index| {
        let last = sample.as_bytes().len() / 2 - 1;
        with_value(sample, last, index as i16)
    })
}

/// Returns the sample as the guest would read it with another value at `at`.
fn with_value(sample: &Sample, at: usize, value: i16) -> Result<Sample, String> {
    let mut bytes = sample.as_bytes().to_vec();
    bytes[2 * at..][..2].copy_from_slice(&value.to_le_bytes());
    let read = Sample::from_bytes(&EvalSpec::micro().dims, &bytes);
    read.map_err(|error| error.to_string())
}

/// All frames are padding, so no loss is lower than another.
pub fn padding_alone() -> Result<(), String> {
    let mut node = node(1, 1);
    node.data[0].is_pad.fill(true);
    node.min_improvement_bps = 0;
    assert!(!improves(&node, &[&node.data[0]]));
    prove(node.honest().input).map(drop)
}
