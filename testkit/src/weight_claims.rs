//! What a proof leaves to check about weights, without an argument.

use zk0_argument::expert::evaluation::layers::Expert;
use zk0_argument::expert::published::Published;
use zk0_argument::expert::statement::Statement;
use zk0_argument::field::{Extension, Goldilocks};
use zk0_argument::party::{ValueClaim, Weighted};
use zk0_argument::relation::{Part, Parts};
use zk0_argument::transcript::Refused;
use zk0_circuits::model::layout::Layout;
use zk0_circuits::{Digest, EvalSpec, QuantisedWeights};

/// Claims about each kind of matrix, at a point from `seed`, as an argument could leave them. Returns the words and their digest.
pub fn left(weights: [&QuantisedWeights; 2], seed: u32) -> (Vec<u8>, Digest) {
    let spec = EvalSpec::micro();
    let layout = Layout::new(&spec.dims);
    let scales = weights.map(|weights| {
        let tensors = 0..layout.tensors.len();
        tensors
            .map(|tensor| weights.tensor(&layout, tensor).1)
            .collect()
    });
    let expert = Expert::new(&Statement::of_weights(&spec, scales.clone()));
    let mut published = Published {
        parts: Parts::default(),
        claims: vec![],
    };
    let mut coordinate = seed;
    for matrices in &expert.weights {
        let tensor = &expert.builder.relations.tensors[matrices.tensor];
        let parts = tensor.places.iter().map(|place| {
            let point = (0..place.bits).map(|_| {
                coordinate += 1;
                Extension([Goldilocks::from_u32(coordinate), Goldilocks::ONE])
            });
            let part = published.parts.add(Part::Point(point.collect()));
            (place.shift, part)
        });
        let about = Weighted {
            source: tensor.source,
            offset: tensor.offset,
            parts: parts.collect(),
            instances: None,
        };
        published.claims.push(ValueClaim {
            about,
            value: Extension::ZERO,
        });
    }
    for (model, weights) in weights.iter().enumerate() {
        let tensor = |number| Ok::<_, Refused>(weights.tensor(&layout, number).0);
        let sums = published.sums(&expert, model, layout.tensors.len(), tensor);
        for (claim, sum) in published.claims.iter_mut().zip(sums.unwrap()) {
            claim.value += sum;
        }
    }
    let words = published.words();
    let bytes = words.iter().flat_map(|word| word.to_le_bytes()).collect();
    (bytes, published.digest(&scales))
}
