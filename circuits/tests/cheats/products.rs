//! Cheats with matrix products, in mode `checked`.

use super::relation::relation;
use super::verifier::{checked, drawn, improves, loss, losses, name_weights, share_of_quantile};
use crate::claims::{louder, nudged, quantise, Node, Random, Tensors};
use std::ops::Range;
use zk0_circuits::claim::hinted_input::HintedInput;
use zk0_circuits::claim::terms::Model;
use zk0_circuits::freivalds::hints::{coefficients, Hints};
use zk0_circuits::model::arithmetic::products::Rows;
use zk0_circuits::model::draw::draw;
use zk0_circuits::model::eval::{Evaluator, LossSum};
use zk0_circuits::model::layout::expert_tensors;
use zk0_circuits::model::linear::Linear;
use zk0_circuits::model::multiply::{Direct, Multiply};
use zk0_circuits::model::parameters::Parameters;
use zk0_circuits::model::site::{EvalError, Site};
use zk0_circuits::{EvalSpec, PrivateInput, QuantisedWeights};

/// A node that contributes its base unchanged, so that no claim of an improvement is true.
struct FreeRider {
    node: Node,
    input: PrivateInput,
}

impl FreeRider {
    fn new() -> Self {
        let mut node = Node::new(&EvalSpec::micro(), 12, 8, 11);
        // With a loud base, almost any change of sums gives a lower loss.
        node.base = louder(&node.base, 0.5);
        node.update = node.base.clone();
        let mut input = node.honest().input;
        name_weights(&mut input);
        Self { node, input }
    }

    fn files(&self) -> [&QuantisedWeights; 2] {
        [&self.input.base, &self.input.update]
    }

    /// Makes the update's hinted sums on the sample opened at `position` as `forge` changes them, and returns them with the loss that
    /// they lead to.
    fn forge(
        &self,
        position: usize,
        forge: impl FnMut(Site, &mut [i32]),
    ) -> (Hints<'static>, LossSum) {
        let evaluator = Evaluator::new(&self.node.spec).unwrap();
        let parameters = Parameters::of(&self.node.spec, &self.input.update);
        let mut forger = Forger {
            direct: evaluator.direct(&self.input.update).unwrap(),
            sums: vec![],
            forge,
        };
        let sample = &self.input.openings[position].sample;
        let terms = &self.input.header.terms;
        let draw = draw(
            &self.node.spec,
            &terms.challenge,
            position as u32,
            terms.eval_samples,
        );
        let loss = evaluator.loss(&parameters, &mut forger, sample, &draw);
        (Hints::new(&forger.sums), loss.unwrap())
    }

    fn hinted(&self) -> HintedInput<'static> {
        HintedInput::of(&self.input).unwrap()
    }

    fn claim(&self, cheat: &HintedInput<'static>) -> Result<(), String> {
        assert!(!improves(&self.node, &drawn(&self.node)));
        checked(cheat, self.files()).map(drop)
    }

    /// For each sample, makes up sums until the loss is this share of the true one. The shares are alike, so that the test passes.
    fn forge_all(
        &self,
        shares: Range<f64>,
        mut forge: impl FnMut(&mut Random, Site, &mut [i32]),
    ) -> Vec<Hints<'static>> {
        let made_up = |position| {
            let (_, honest) = self.forge(position, |_, _| ());
            let hints = (0..20_000).find_map(|seed| {
                let mut random = Random(seed);
                let (hints, loss) =
                    self.forge(position, |site, sums| forge(&mut random, site, sums));
                let share = loss.squared_error as f64 / honest.squared_error as f64;
                shares.contains(&share).then_some(hints)
            });
            hints.expect("made-up sums that look as wanted")
        };
        (0..self.input.openings.len()).map(made_up).collect()
    }

    /// Claims the update's sums as `forge` changes them until the losses are such shares of the true ones, and draws the seed anew from
    /// them, as the protocol does.
    fn make_up(
        &self,
        shares: Range<f64>,
        forge: impl FnMut(&mut Random, Site, &mut [i32]),
    ) -> Result<(), String> {
        let mut cheat = self.hinted();
        cheat.update.hints = self.forge_all(shares, forge);
        cheat.seal(self.files()).unwrap();
        self.claim(&cheat)
    }

    /// Draws the seed from honest hints. Then changes the sums of a model's last MLP in a way that a check with that seed's
    /// coefficients does not see, until the losses look as wanted.
    fn sums_last(&self, model: Model, shares: Range<f64>) -> Result<(), String> {
        let mut cheat = self.hinted();
        let evaluator = Evaluator::new(&self.node.spec).unwrap();
        let dims = self.node.spec.dims;
        let (outputs, last) = (dims.expert_width as usize, dims.layers as usize - 1);
        let unseen = relation(&coefficients(&evaluator, &cheat.seed), 0, outputs);
        let largest = unseen.iter().map(|step| step.abs()).max().unwrap();
        let hints = self.forge_all(shares, |random, site, sums| {
            if site == Site::Down(last) {
                // Small changes are as likely as large ones.
                let size = (1 << 29) as f32 * random.unit().abs().powi(4);
                for row in sums.chunks_exact_mut(outputs) {
                    let times = (random.unit() * size) as i64 / largest;
                    let steps = unseen.iter().map(|step| times * step);
                    row.iter_mut()
                        .zip(steps)
                        .for_each(|(sum, step)| *sum += step as i32);
                }
            }
        });
        match model {
            Model::Base => cheat.base.hints = hints,
            Model::Update => cheat.update.hints = hints,
        }
        self.claim(&cheat)
    }
}

/// Computes every product, changes it, and keeps it.
struct Forger<'a, F> {
    direct: Direct<'a>,
    sums: Vec<i32>,
    forge: F,
}

impl<F: FnMut(Site, &mut [i32])> Forger<'_, F> {
    fn keep(&mut self, site: Site, mut sums: Vec<i32>) -> Vec<i32> {
        (self.forge)(site, &mut sums);
        self.sums.extend_from_slice(&sums);
        sums
    }
}

impl<F: FnMut(Site, &mut [i32])> Multiply for Forger<'_, F> {
    type Sums = Vec<i32>;

    fn linear(
        &mut self,
        index: usize,
        linear: &Linear,
        input: &[i16],
    ) -> Result<Vec<i32>, EvalError> {
        let sums = self.direct.linear(index, linear, input)?;
        Ok(self.keep(linear.outputs[0].site, sums))
    }

    fn scores(&mut self, site: Site, a: Rows<'_>, b: Rows<'_>) -> Result<Vec<i32>, EvalError> {
        let sums = self.direct.scores(site, a, b)?;
        Ok(self.keep(site, sums))
    }

    fn mix(&mut self, site: Site, a: Rows<'_>, b: Rows<'_>) -> Result<Vec<i32>, EvalError> {
        let sums = self.direct.mix(site, a, b)?;
        Ok(self.keep(site, sums))
    }
}

/// The velocity is calmer than the update's.
pub fn velocity() -> Result<(), String> {
    FreeRider::new().make_up(0.0..0.97, |random, site, sums| {
        if site == Site::Velocity {
            let factor = 1.0 + 1.5 * random.unit();
            sums.iter_mut()
                .for_each(|sum| *sum = (*sum as f32 * factor) as i32);
        }
    })
}

/// The attention is elsewhere than the update's.
pub fn scores() -> Result<(), String> {
    FreeRider::new().make_up(0.85..0.95, |random, site, sums| {
        if let Site::Scores(_) = site {
            sums.iter_mut()
                .for_each(|sum| *sum = random.bits() as i32 >> 4);
        }
    })
}

/// The attention is to values that do not exist.
pub fn outputs() -> Result<(), String> {
    FreeRider::new().make_up(0.85..0.95, |random, site, sums| {
        if let Site::Attention(_) = site {
            sums.iter_mut()
                .for_each(|sum| *sum = random.bits() as i32 >> 4);
        }
    })
}

/// Chooses the update's sums after the coefficients are known, so that its loss looks lower than it is.
pub fn update_sums_last() -> Result<(), String> {
    FreeRider::new().sums_last(Model::Update, 0.90..0.94)
}

/// Chooses the base's sums after the coefficients are known, so that its loss looks higher than it is.
pub fn base_sums_last() -> Result<(), String> {
    FreeRider::new().sums_last(Model::Base, 1.02..1.10)
}

/// Evaluates an update that improves. Once the coefficients are known, contributes another update that has the same projections.
pub fn update_last() -> Result<(), String> {
    let mut node = Node::new(&EvalSpec::micro(), 12, 8, 15);
    let samples = &drawn(&node)[..];
    let before = loss(&node, &node.base, samples);
    let good = (0..5000)
        .map(|seed| nudged(&node.base, &mut Random(seed), 0.1))
        .find(|update| {
            let after = losses(&node, update, samples);
            share_of_quantile(&node, &losses(&node, &node.base, samples), &after) > 1.1
                && after.iter().sum::<f64>() > 0.9 * before
        })
        .expect("an update that improves");
    node.update = good.clone();
    let mut input = node.honest().input;
    name_weights(&mut input);
    let mut cheat = HintedInput::of(&input).unwrap();

    let evaluator = Evaluator::new(&node.spec).unwrap();
    let coefficients = coefficients(&evaluator, &cheat.seed);
    let mlp = node.spec.dims.expert_mlp as usize;
    // The first outputs of the product are the rows of the gate. The rows of the other factor follow.
    let unseen = [0, mlp].map(|first| relation(&coefficients, first, mlp));
    node.update = (0..1000)
        .filter_map(|seed| moved(&node.spec, &good, &unseen, &mut Random(seed)))
        .find(|update| loss(&node, update, samples) > 1.005 * before)
        .expect("an update that does not improve");
    assert!(!improves(&node, samples));
    input.update = quantise(&node.spec, &node.update);
    name_weights(&mut input);
    cheat.header = input.header.clone();
    checked(&cheat, [&input.base, &input.update]).map(drop)
}

/// Adds `unseen` to columns of the gates (the first) and ups (the second) or subtracts it, at random, where the result fits int16.
/// Returns `None` if the scale of a tensor changes.
fn moved(
    spec: &EvalSpec,
    tensors: &Tensors,
    unseen: &[Vec<i64>; 2],
    random: &mut Random,
) -> Option<Tensors> {
    let mut moved = tensors.clone();
    // Quantised weights begin with the fraction bits of each tensor.
    let bits = |tensors: &Tensors, index: usize| quantise(spec, tensors).as_bytes()[2 * index];
    for (index, tensor) in expert_tensors(&spec.dims).iter().enumerate() {
        let unseen = match tensor.name.split('.').nth_back(1) {
            Some("gate_proj") => &unseen[0],
            Some("up_proj") => &unseen[1],
            _ => continue,
        };
        let unit = (1u64 << bits(tensors, index)) as f32;
        let (matrix, columns) = (moved.get_mut(&tensor.name)?, tensor.shape[1]);
        for column in 0..columns {
            let sign = random.unit().signum();
            let rows = matrix.iter().skip(column).step_by(columns).zip(unseen);
            let new: Vec<f32> = rows
                .map(|(value, &step)| (value * unit).round_ties_even() + sign * step as f32)
                .collect();
            if new.iter().all(|value| value.abs() <= 32767.0) {
                let rows = matrix.iter_mut().skip(column).step_by(columns);
                rows.zip(new).for_each(|(value, new)| *value = new / unit);
            }
        }
        if bits(&moved, index) != bits(tensors, index) {
            return None;
        }
    }
    Some(moved)
}
