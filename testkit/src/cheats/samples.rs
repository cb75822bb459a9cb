//! Cheats that open other samples than drawn, or misstate their data.

use super::verifier::{drawn, loss, loss_at, prove, share_of_quantile};
use crate::claims::{nudged, ClaimingNode, FloatSample, Random, SALT};
use zk0_circuits::claim::challenge::sample_indices;
use zk0_circuits::claim::dataset::{check_leaves, leaf, salt_commitment};
use zk0_circuits::claim::private_input::Opening;
use zk0_circuits::vm::digest::tagged_sha256;
use zk0_circuits::vm::merkle;
use zk0_circuits::{Digest, EvalSpec, Sample};

fn node(samples: usize, count: u32) -> ClaimingNode {
    ClaimingNode::new(&EvalSpec::micro(), samples, count, 11)
}

fn open(dataset: &[Sample], leaves: &[Digest], index: usize) -> Opening {
    Opening {
        index: index as u64,
        sample: dataset[index].clone(),
        path: merkle::path(leaves, index).unwrap(),
    }
}

/// An update that passes the test on `some` (sample, position), and raises the loss on the drawn samples.
fn help_only(node: &mut ClaimingNode, some: &[(&FloatSample, usize)], drawn: &[FloatSample]) {
    let on_some = |node: &ClaimingNode, tensors: &_| -> Vec<f64> {
        let losses = some.iter();
        losses
            .map(|&(parts, position)| loss_at(node, tensors, parts, position))
            .collect()
    };
    for seed in 0..20_000 {
        let amount = [0.1, 0.3, 0.6][seed as usize % 3];
        node.update = nudged(&node.base, &mut Random(seed), amount);
        if loss(node, &node.update, drawn) > 1.02 * loss(node, &node.base, drawn) {
            let [before, after] = [&node.base, &node.update].map(|tensors| on_some(node, tensors));
            // The guest's fixed-point losses differ slightly.
            if share_of_quantile(node, &before, &after) > 1.1 {
                return;
            }
        }
    }
    panic!("no update helps only these samples");
}

/// Helps on the first two drawn samples, harms on all four.
pub fn fewer() -> Result<(), String> {
    let mut node = node(6, 4);
    let drawn = drawn(&node);
    help_only(&mut node, &[(&drawn[0], 0), (&drawn[1], 1)], &drawn);
    let mut input = node.honest().input;
    input.openings.truncate(2);
    prove(input).map(drop)
}

/// Helps only on samples not drawn.
pub fn lucky() -> Result<(), String> {
    let mut node = node(6, 2);
    let indices = sample_indices(&node.challenge, 6, 2).unwrap();
    let others: Vec<usize> = (0..6)
        .filter(|index| !indices.contains(&(*index as u64)))
        .collect();
    let (data, drawn) = (node.data.clone(), drawn(&node));
    let lucky = [(&data[others[0]], 0), (&data[others[1]], 1)];
    help_only(&mut node, &lucky, &drawn);
    let honest = node.honest();
    let mut input = honest.input;
    let opened = others[..2].iter();
    input.openings = opened
        .map(|index| open(&honest.dataset, &honest.leaves, *index))
        .collect();
    prove(input).map(drop)
}

/// Helps on samples outside the dataset, which replace those drawn.
pub fn invented() -> Result<(), String> {
    let mut node = node(6, 2);
    let drawn = drawn(&node);
    let invented = [8, 9].map(|seed| FloatSample::random(&node.spec, &mut Random(seed), 9, 0));
    help_only(&mut node, &[(&invented[0], 0), (&invented[1], 1)], &drawn);
    let mut input = node.honest().input;
    for (opening, invented) in input.openings.iter_mut().zip(&invented) {
        opening.sample = invented.quantise(&node.spec);
    }
    prove(input).map(drop)
}

/// Helps on one of two samples, and waits for a challenge that draws this one twice before the other.
pub fn twice() -> Result<(), String> {
    let mut node = node(2, 2);
    // The first bits of a block's four little-endian words choose the samples.
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
    help_only(&mut node, &some, &data);
    let honest = node.honest();
    let mut input = honest.input;
    input.openings = vec![open(&honest.dataset, &honest.leaves, 0); 2];
    prove(input).map(drop)
}

/// The dataset counts two samples. The second place holds the hash of two more, to which both indices lead, by too long paths. The update
/// helps on them, and harms on the first sample.
pub fn deeper() -> Result<(), String> {
    let mut node = node(3, 2);
    let drawn = sample_indices(&node.challenge, 2, 2).unwrap();
    let data = node.data.clone();
    // Indices 0 and 1 lead to samples 1 and 2.
    let opened: Vec<usize> = drawn.iter().map(|index| *index as usize + 1).collect();
    let hidden = [(&data[opened[0]], 0), (&data[opened[1]], 1)];
    help_only(&mut node, &hidden, &data[..1]);
    let honest = node.honest();
    let leaves = honest.leaves;
    let mut input = honest.input;
    let dataset = &mut input.header.terms.dataset;
    let below = merkle::node_hash(&leaves[1], &leaves[2]);
    dataset.root = merkle::node_hash(&leaves[0], &below);
    dataset.samples = 2;
    let opening = |(index, sample): (&u64, &usize)| Opening {
        index: *index,
        sample: honest.dataset[*sample].clone(),
        path: vec![leaves[3 - sample], leaves[0]],
    };
    input.openings = drawn.iter().zip(&opened).map(opening).collect();
    prove(input).map(drop)
}

/// The dataset counts six, and each index leads to one sample.
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

/// Two samples count as six, each under three salts. The node waits for a challenge that draws two under one salt.
pub fn salted_copies() -> Result<(), String> {
    let mut node = node(6, 2);
    for copy in 2..6 {
        node.data[copy] = node.data[copy % 2].clone();
    }
    let mut refused = Err("no challenge draws two samples under one salt".to_string());
    for challenge in 0..=255 {
        node.challenge = Digest([challenge; 32]);
        let mut drawn = sample_indices(&node.challenge, 6, 2).unwrap();
        drawn.sort_unstable();
        if drawn != [2, 3] {
            continue;
        }
        let salts = [0, 0, 1, 1, 2, 2].map(|salt| [salt; 32]);
        refused = claim_copies(&node, salts, |sample, _| Ok(sample.clone()));
        if refused.is_ok() {
            break;
        }
    }
    refused
}

/// Claims equal samples with different leaves: by their salts, or by what `copy` changes.
fn claim_copies(
    node: &ClaimingNode,
    salts: [[u8; 32]; 6],
    copy: impl Fn(&Sample, usize) -> Result<Sample, String>,
) -> Result<(), String> {
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
    let drawn: Vec<usize> = input
        .openings
        .iter()
        .map(|opening| opening.index as usize)
        .collect();
    input.openings = drawn
        .iter()
        .map(|index| open(&dataset, &leaves, *index))
        .collect();
    input.header.salt = salts[drawn[0]];
    let claim = prove(input)?;
    // A verifier with the leaves sees no duplicate.
    assert_eq!(check_leaves(&claim.terms.dataset, &leaves), Ok(()));
    Ok(())
}

/// Six samples, equal but for `copy`.
fn copies(copy: impl Fn(&Sample, usize) -> Result<Sample, String>) -> Result<(), String> {
    let mut node = node(3, 1);
    let one = node.data[2].clone();
    (node.data, node.eval_samples) = (vec![one; 6], 4);
    claim_copies(&node, [SALT; 6], copy)
}

/// Another number marks the last frame as padding.
pub fn flagged_copies() -> Result<(), String> {
    let chunk = EvalSpec::micro().dims.chunk as usize;
    copies(|sample, index| with_value(sample, chunk, 1 + index as i16))
}

/// Another frame, before real ones, is padding.
pub fn masked_copies() -> Result<(), String> {
    let dims = EvalSpec::micro().dims;
    let (chunk, width) = (dims.chunk as usize, dims.max_action_dim as usize);
    copies(|sample, index| {
        let mut sample = sample.clone();
        for frame in (0..3).filter(|frame| index >> frame & 1 != 0) {
            let actions = 1 + chunk + frame * width;
            for at in actions..actions + width {
                sample = with_value(&sample, at, 0)?;
            }
            sample = with_value(&sample, 1 + frame, 1)?;
        }
        Ok(sample)
    })
}

/// Changes an action in the last frame, which is padding.
pub fn written_copies() -> Result<(), String> {
    let dims = EvalSpec::micro().dims;
    let (chunk, width) = (dims.chunk as usize, dims.max_action_dim as usize);
    copies(|sample, index| with_value(sample, 1 + chunk + (chunk - 1) * width, index as i16))
}

/// Changes a number in a dimension that no arm has.
pub fn widened_copies() -> Result<(), String> {
    let dims = EvalSpec::micro().dims;
    let beyond = 1 + dims.chunk as usize + dims.action_dim as usize;
    copies(|sample, index| with_value(sample, beyond, index as i16))
}

/// Another number follows the last value. Nothing reads it.
pub fn padded_copies() -> Result<(), String> {
    copies(|sample, index| {
        let last = sample.as_bytes().len() / 2 - 1;
        with_value(sample, last, index as i16)
    })
}

/// The sample as the guest reads it, with another value at `at`.
fn with_value(sample: &Sample, at: usize, value: i16) -> Result<Sample, String> {
    let mut bytes = sample.as_bytes().to_vec();
    bytes[2 * at..][..2].copy_from_slice(&value.to_le_bytes());
    let read = Sample::from_bytes(&EvalSpec::micro().dims, &bytes);
    read.map_err(|error| error.to_string())
}
