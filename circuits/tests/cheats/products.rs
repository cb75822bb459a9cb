//! Cheats with matrix products, in mode `checked`.

use super::relation::relation;
use super::verifier::{checked, improves, loss, name_weights};
use crate::claims::{nudged, quantise, Node, Parts, Random, Tensors};
use zk0_circuits::claim::hinted_input::HintedInput;
use zk0_circuits::claim::terms::Model;
use zk0_circuits::freivalds::hints::{coefficients, Hints};
use zk0_circuits::model::arithmetic::products::Rows;
use zk0_circuits::model::draw::{draw, Draw};
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
        let mut node = Node::new(&EvalSpec::micro(), 3, 1, 11);
        node.update = node.base.clone();
        let mut input = node.honest().input;
        name_weights(&mut input);
        Self { node, input }
    }

    fn files(&self) -> [&QuantisedWeights; 2] {
        [&self.input.base, &self.input.update]
    }

    fn drawn(&self) -> &Parts {
        &self.node.data[self.input.openings[0].index as usize]
    }

    fn draw(&self) -> Draw {
        draw(&self.node.spec, &self.input.header.terms.challenge, 0)
    }

    /// Makes the update's hinted sums as `forge` changes them, and returns them with the loss that they lead to.
    fn forge(&self, forge: impl FnMut(Site, &mut [i32])) -> (Hints<'static>, LossSum) {
        let evaluator = Evaluator::new(&self.node.spec).unwrap();
        let parameters = Parameters::of(&self.node.spec, &self.input.update);
        let mut forger = Forger {
            direct: evaluator.direct(&self.input.update).unwrap(),
            sums: vec![],
            forge,
        };
        let sample = &self.input.openings[0].sample;
        let loss = evaluator.loss(&parameters, &mut forger, sample, &self.draw());
        (Hints::new(&forger.sums), loss.unwrap())
    }

    fn hinted(&self) -> HintedInput<'static> {
        HintedInput::of(&self.input).unwrap()
    }

    fn claim(&self, cheat: &HintedInput<'static>) -> Result<(), String> {
        assert!(!improves(&self.node, &[self.drawn()]));
        checked(cheat, self.files()).map(drop)
    }

    /// Claims the update's sums as `forge` changes them, and draws the seed anew from them, as the protocol does. Tries until the
    /// loss looks lower.
    fn make_up(&self, mut forge: impl FnMut(&mut Random, Site, &mut [i32])) -> Result<(), String> {
        let (_, honest) = self.forge(|_, _| ());
        for seed in 0..100 {
            let mut random = Random(seed);
            let (hints, loss) = self.forge(|site, sums| forge(&mut random, site, sums));
            if loss.squared_error as f64 <= 0.98 * honest.squared_error as f64 {
                let mut cheat = self.hinted();
                cheat.update.hints[0] = hints;
                cheat.seal(self.files()).unwrap();
                return self.claim(&cheat);
            }
        }
        panic!("no made-up sums look like an improvement");
    }

    /// Draws the seed from honest hints. Then changes the sums of a model's last MLP in a way that a check with that seed's
    /// coefficients does not see, until the loss looks as wanted.
    fn sums_last(&self, model: Model, looks: impl Fn(f64) -> bool) -> Result<(), String> {
        let mut cheat = self.hinted();
        let evaluator = Evaluator::new(&self.node.spec).unwrap();
        let dims = self.node.spec.dims;
        let (outputs, last) = (dims.expert_width as usize, dims.layers as usize - 1);
        let unseen = relation(&coefficients(&evaluator, &cheat.seed), 0, outputs);
        let largest = unseen.iter().map(|step| step.abs()).max().unwrap();
        let (_, honest) = self.forge(|_, _| ());
        for seed in 0..1000 {
            let mut random = Random(seed);
            let (hints, loss) = self.forge(|site, sums| {
                if site == Site::Down(last) {
                    for row in sums.chunks_exact_mut(outputs) {
                        let times = (random.unit() * (1 << 29) as f32) as i64 / largest;
                        let steps = unseen.iter().map(|step| times * step);
                        row.iter_mut()
                            .zip(steps)
                            .for_each(|(sum, step)| *sum += step as i32);
                    }
                }
            });
            if looks(loss.squared_error as f64 / honest.squared_error as f64) {
                match model {
                    Model::Base => cheat.base.hints[0] = hints,
                    Model::Update => cheat.update.hints[0] = hints,
                }
                return self.claim(&cheat);
            }
        }
        panic!("no change that the check does not see looks like an improvement");
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
    FreeRider::new().make_up(|_, site, sums| {
        if site == Site::Velocity {
            sums.iter_mut().for_each(|sum| *sum /= 4);
        }
    })
}

/// The attention is elsewhere than the update's.
pub fn scores() -> Result<(), String> {
    FreeRider::new().make_up(|random, site, sums| {
        if let Site::Scores(_) = site {
            sums.iter_mut()
                .for_each(|sum| *sum = random.bits() as i32 >> 4);
        }
    })
}

/// The attention is to values that do not exist.
pub fn outputs() -> Result<(), String> {
    FreeRider::new().make_up(|random, site, sums| {
        if let Site::Attention(_) = site {
            sums.iter_mut()
                .for_each(|sum| *sum = random.bits() as i32 >> 4);
        }
    })
}

/// Chooses the update's sums after the coefficients are known, so that its loss looks lower than it is.
pub fn update_sums_last() -> Result<(), String> {
    FreeRider::new().sums_last(Model::Update, |share| share < 0.98)
}

/// Chooses the base's sums after the coefficients are known, so that its loss looks higher than it is.
pub fn base_sums_last() -> Result<(), String> {
    FreeRider::new().sums_last(Model::Base, |share| share > 1.02)
}

/// Evaluates an update that improves. Once the coefficients are known, contributes another update that has the same projections.
pub fn update_last() -> Result<(), String> {
    let mut node = Node::new(&EvalSpec::micro(), 3, 1, 11);
    let drawn = node.honest().input.openings[0].index as usize;
    let drawn = node.data[drawn].clone();
    let before = loss(&node, &node.base, &[&drawn]);
    let good = (0..1000)
        .map(|seed| nudged(&node.base, &mut Random(seed), 0.1))
        .find(|update| (0.98..0.985).contains(&(loss(&node, update, &[&drawn]) / before)))
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
        .find(|update| loss(&node, update, &[&drawn]) > 1.005 * before)
        .expect("an update that does not improve");
    assert!(!improves(&node, &[&drawn]));
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
