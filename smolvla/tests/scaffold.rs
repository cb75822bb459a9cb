//! SCAFFOLD: control variates that follow from public weights are those of Algorithm 1, and hold nodes together that would drift apart.

use candle_core::{Device, Var};
use std::collections::{BTreeMap, BTreeSet};
use zk0_smolvla::train::optimizer::{Optimizer, Sgd};
use zk0_smolvla::train::scaffold::{ControlVariates, PastRound};
use zk0_tensors::{TensorData, TensorSet};

const STEPS: usize = 20;
const RATE: f64 = 0.02;
const START: [f64; 3] = [0.5, -1.0, 0.25];

/// The loss of each node is Σ ½·a·(w − b)²: they want different weights, and disagree about how much each weight matters.
const CURVATURES: [[f64; 3]; 4] = [
    [1.0, 10.0, 0.1],
    [10.0, 1.0, 1.0],
    [2.0, 3.0, 5.0],
    [0.5, 4.0, 8.0],
];
const WANTED: [[f64; 3]; 4] = [
    [1.0, 0.0, -1.0],
    [-1.0, 1.0, 0.0],
    [0.0, -2.0, 2.0],
    [3.0, 1.0, -2.0],
];

fn set(values: [f64; 3]) -> TensorSet {
    let data = TensorData {
        shape: vec![3],
        data: values.map(|value| value as f32).to_vec(),
    };
    TensorSet::from([("w".to_string(), data)])
}

fn values(set: &TensorSet) -> [f64; 3] {
    let data = &set["w"].data;
    std::array::from_fn(|at| f64::from(data[at]))
}

/// What a node's weights become from `base`, by [`Sgd`].
fn trained(node: usize, base: &TensorSet, correction: Option<&TensorSet>) -> TensorSet {
    let device = Device::Cpu;
    let w = Var::from_vec(base["w"].data.clone(), 3, &device).unwrap();
    let variables = BTreeMap::from([("w".to_string(), w.clone())]);
    let mut sgd = Sgd::new(&variables, correction).unwrap();
    let tensor = |values: [f64; 3]| {
        let values = values.map(|value| value as f32);
        Var::from_slice(&values, 3, &device).unwrap().into_inner()
    };
    let (curvature, wanted) = (tensor(CURVATURES[node]), tensor(WANTED[node]));
    for _ in 0..STEPS {
        let off = (w.as_tensor() - &wanted).unwrap().sqr().unwrap();
        let loss = (off * &curvature).unwrap().sum_all().unwrap();
        let loss = (loss * 0.5).unwrap();
        sgd.step(&loss.backward().unwrap(), RATE).unwrap();
    }
    let data = w.to_vec1().unwrap();
    let shape = vec![3];
    TensorSet::from([("w".to_string(), TensorData { shape, data })])
}

fn mean(updates: &BTreeMap<usize, TensorSet>) -> TensorSet {
    let all: Vec<_> = updates.values().map(values).collect();
    set(std::array::from_fn(|at| {
        all.iter().map(|one| one[at]).sum::<f64>() / all.len() as f64
    }))
}

/// A round as everybody sees it afterwards.
struct Public {
    base: TensorSet,
    updates: BTreeMap<usize, TensorSet>,
    result: TensorSet,
}

/// The control variates of a node, from what is public of the rounds so far.
fn recomputed(node: usize, rounds: &[Public]) -> ControlVariates {
    let mut variates = ControlVariates::zero(&set(START));
    let mut contributed = BTreeSet::new();
    for round in rounds {
        let sat_out = contributed.iter();
        let sat_out = sat_out.filter(|node| !round.updates.contains_key(node));
        let past = PastRound {
            base: &round.base,
            result: &round.result,
            own: round.updates.get(&node),
            contributed: round.updates.len(),
            sat_out: sat_out.count(),
            way: STEPS as f64 * RATE,
        };
        variates.observe(&past).unwrap();
        contributed.extend(round.updates.keys().copied());
    }
    variates
}

/// Rounds in which these nodes take part. In each, a node computes its control variates from the beginning.
fn rounds(who: &[&[usize]], by_scaffold: bool) -> Vec<Public> {
    let (mut base, mut rounds) = (set(START), Vec::new());
    for nodes in who {
        let trained = |node: &usize| {
            let correction = match by_scaffold {
                true => recomputed(*node, &rounds).correction(),
                false => None,
            };
            (*node, trained(*node, &base, correction.as_ref()))
        };
        let updates: BTreeMap<_, _> = nodes.iter().map(trained).collect();
        let result = mean(&updates);
        rounds.push(Public {
            base: std::mem::replace(&mut base, result.clone()),
            updates,
            result,
        });
    }
    rounds
}

/// Algorithm 1 of the paper with option II and a global step of 1, in float64: nodes send the change of their cᵢ, and the server keeps c.
struct Algorithm1 {
    x: [f64; 3],
    c: [f64; 3],
    own: BTreeMap<usize, [f64; 3]>,
}

impl Algorithm1 {
    /// Nodes that come later join with the server's c, so that c stays the mean.
    fn round(&mut self, sampled: &[usize]) {
        for node in sampled {
            self.own.entry(*node).or_insert(self.c);
        }
        let (x, c, nodes) = (self.x, self.c, self.own.len() as f64);
        let (mut moved, mut changed) = ([0.0; 3], [0.0; 3]);
        for node in sampled {
            let own = self.own.get_mut(node).unwrap();
            let mut y = x;
            for _ in 0..STEPS {
                for at in 0..3 {
                    let gradient = CURVATURES[*node][at] * (y[at] - WANTED[*node][at]);
                    y[at] -= RATE * (gradient - own[at] + c[at]);
                }
            }
            for at in 0..3 {
                let new = own[at] - c[at] + (x[at] - y[at]) / (STEPS as f64 * RATE);
                changed[at] += new - own[at];
                moved[at] += y[at] - x[at];
                own[at] = new;
            }
        }
        for at in 0..3 {
            self.x[at] += moved[at] / sampled.len() as f64;
            self.c[at] += changed[at] / nodes;
        }
    }
}

#[track_caller]
fn near(what: &str, found: [f64; 3], expected: [f64; 3], within: f64) {
    for at in 0..3 {
        let off = (found[at] - expected[at]).abs();
        assert!(off < within, "{what}: {found:?} for {expected:?}");
    }
}

fn is_algorithm_1(who: &[&[usize]]) {
    let found = rounds(who, true);
    let mut paper = Algorithm1 {
        x: START,
        c: [0.0; 3],
        own: BTreeMap::new(),
    };
    for (number, round) in found.iter().enumerate() {
        paper.round(who[number]);
        let what = format!("round {number}");
        near(&what, values(&round.result), paper.x, 2e-5);
        for (node, own) in &paper.own {
            let variates = recomputed(*node, &found[..=number]);
            near(
                &format!("{what}, c"),
                values(&variates.global),
                paper.c,
                2e-4,
            );
            let found = values(&variates.own.unwrap());
            near(&format!("{what}, node {node}"), found, *own, 2e-4);
        }
    }
}

#[test]
fn what_follows_from_public_weights_is_algorithm_1() {
    is_algorithm_1(&[&[0, 1, 2][..]; 12]);
}

#[test]
fn nodes_may_miss_rounds() {
    is_algorithm_1(&[
        &[0, 1, 2],
        &[0, 1],
        &[2],
        &[1, 2],
        &[0, 2],
        &[0, 1, 2],
        &[1],
    ]);
}

#[test]
fn a_node_that_comes_later_leaves_the_mean_as_it_is() {
    is_algorithm_1(&[
        &[0, 1],
        &[0, 1],
        &[0, 1, 3],
        &[1, 2, 3],
        &[0, 1, 2, 3],
        &[2],
    ]);
    // It corrects nothing before its first contribution.
    let found = rounds(&[&[0, 1], &[0, 1]], true);
    assert_eq!(recomputed(3, &found).correction(), None);
    assert!(recomputed(0, &found).correction().is_some());
}

/// Where each node's own optimum pulls, the mean of plain steps stops beside the optimum of all.
#[test]
fn nodes_that_would_drift_apart_reach_the_optimum_of_all() {
    let nodes = [0, 1, 2];
    let optimum: [f64; 3] = std::array::from_fn(|at| {
        let sum = |of: &dyn Fn(usize) -> f64| nodes.iter().map(|node| of(*node)).sum::<f64>();
        sum(&|node| CURVATURES[node][at] * WANTED[node][at]) / sum(&|node| CURVATURES[node][at])
    });
    let furthest = |rounds: &[Public]| {
        let last = values(&rounds.last().unwrap().result);
        (0..3)
            .map(|at| (last[at] - optimum[at]).abs())
            .fold(0.0, f64::max)
    };
    let who = [&nodes[..]; 40];
    assert!(furthest(&rounds(&who, true)) < 1e-4);
    assert!(furthest(&rounds(&who, false)) > 0.3);
}

/// A round that nobody contributed to changes nothing.
#[test]
fn a_round_without_contributions_counts_for_nothing() {
    let found = rounds(&[&[0, 1], &[1]], true);
    let mut variates = recomputed(0, &found);
    let before = variates.clone();
    let base = set(START);
    let past = PastRound {
        base: &base,
        result: &base,
        own: None,
        contributed: 0,
        sat_out: 2,
        way: 1.0,
    };
    variates.observe(&past).unwrap();
    assert_eq!(variates, before);
}

/// A step is x − η·(g + d), computed here in float64. Without d it is that of `torch.optim.SGD`.
#[test]
fn a_step_of_sgd_is_that_of_the_formula() {
    for correction in [None, Some([0.5, -0.25, 0.0])] {
        let mut w = [0.5f64, -1.0, 0.25];
        let variable = Var::from_vec(w.map(|w| w as f32).to_vec(), 3, &Device::Cpu).unwrap();
        let variables = BTreeMap::from([("w".to_string(), variable.clone())]);
        let mut sgd = Sgd::new(&variables, correction.map(set).as_ref()).unwrap();
        for step in 0..5 {
            // The loss is Σ w³.
            let cube = (variable.sqr().unwrap() * variable.as_tensor()).unwrap();
            let gradients = cube.sum_all().unwrap().backward().unwrap();
            let stepped = sgd.step(&gradients, RATE).unwrap();
            let gradient = w.map(|w| 3.0 * w * w);
            let norm = gradient.iter().map(|g| g * g).sum::<f64>().sqrt();
            assert!((stepped.gradient_norm / norm - 1.0).abs() < 1e-5);
            let d = correction.unwrap_or_default();
            w = std::array::from_fn(|at| w[at] - RATE * (gradient[at] + d[at]));
            let found = variable.to_vec1::<f32>().unwrap();
            let found = std::array::from_fn(|at| f64::from(found[at]));
            near(&format!("step {step}"), found, w, 1e-6);
        }
    }
}

#[test]
fn what_scaffold_cannot_use_is_named() {
    let variable = Var::from_vec(vec![1.0f32, 2.0, 3.0], 3, &Device::Cpu).unwrap();
    let variables = BTreeMap::from([("w".to_string(), variable.clone())]);
    let why = |correction: &TensorSet| {
        let made = Sgd::new(&variables, Some(correction));
        made.err().unwrap().to_string()
    };
    assert!(why(&TensorSet::new()).contains("'w' is missing"));
    let short = TensorData {
        shape: vec![2],
        data: vec![0.0; 2],
    };
    let short = TensorSet::from([("w".to_string(), short)]);
    assert!(why(&short).contains("shape [2], expected [3]"));

    let mut sgd = Sgd::new(&variables, None).unwrap();
    let loss = (variable.sum_all().unwrap() * f64::INFINITY).unwrap();
    let error = sgd.step(&loss.backward().unwrap(), 0.1).unwrap_err();
    assert!(error.to_string().contains("norm"), "{error}");
    assert_eq!(variable.to_vec1::<f32>().unwrap(), [1.0, 2.0, 3.0]);

    let base = set(START);
    let right = PastRound {
        base: &base,
        result: &base,
        own: Some(&base),
        contributed: 1,
        sat_out: 0,
        way: 1.0,
    };
    let why = |past: PastRound<'_>| {
        let mut variates = ControlVariates::zero(&base);
        let refused = variates.observe(&past).unwrap_err();
        assert_eq!(
            variates,
            ControlVariates::zero(&base),
            "nothing has changed"
        );
        refused.to_string()
    };
    for way in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(why(PastRound { way, ..right }).contains("above 0"));
    }
    let nothing = TensorSet::new();
    for past in [
        PastRound {
            base: &short,
            ..right
        },
        PastRound {
            result: &short,
            ..right
        },
        PastRound {
            own: Some(&short),
            ..right
        },
    ] {
        assert!(why(past).contains("shape [2], expected [3]"));
    }
    assert!(why(PastRound {
        result: &nothing,
        ..right
    })
    .contains("'w' is missing"));
}
