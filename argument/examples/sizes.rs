//! Prints how large an argument is at SmolVLA's full size: `sizes [SAMPLES]`.

use std::env;
use std::error::Error;
use zk0_argument::expert::evaluation::layers::Expert;
use zk0_argument::expert::sizes::Sizes;
use zk0_argument::expert::statement::{Evaluated, Statement};
use zk0_argument::layout::Layout;
use zk0_circuits::model::draw::draw;
use zk0_circuits::model::layout::expert_tensors;
use zk0_circuits::model::spec::Dims;
use zk0_circuits::{Digest, EvalSpec};

fn main() -> Result<(), Box<dyn Error>> {
    let samples = std::env::args()
        .nth(1)
        .map_or(Ok(1), |n| n.parse::<u32>())?;
    let spec = EvalSpec::new(Dims::FULL);
    let tensors = expert_tensors(&spec.dims).len();
    let evaluated = |number| {
        let draw = draw(&spec, &Digest([0; 32]), number, samples);
        Evaluated {
            prefix: 177,
            frames: 50,
            draw,
            losses: [0; 2],
        }
    };
    let statement = Statement {
        context: Digest([0; 32]),
        scales: [vec![14; tensors], vec![14; tensors]],
        saturates: env::args().any(|argument| argument == "saturates"),
        samples: (0..samples).map(evaluated).collect(),
        spec: spec.clone(),
    };
    let expert = Expert::new(&statement);
    let r = &expert.builder.relations;
    let sizes: &Sizes = &expert.builder.sizes;
    println!("axes {:?}", sizes.bits);
    println!("bits of sources {:?}", expert.source_bits);
    let mut by_size = std::collections::BTreeMap::new();
    let mut committed = 0u64;
    for tensor in r.tensors.iter().filter(|t| t.source.0 == 0) {
        let bits: u32 = tensor.places.iter().map(|p| p.bits as u32).sum();
        *by_size.entry(bits).or_insert(0) += 1;
        committed += 1 << bits;
    }
    println!(
        "committed: {:.1} M values; tensors by bits {by_size:?}",
        committed as f64 / 1e6
    );
    let mut by_size = std::collections::BTreeMap::new();
    let mut looked_up = 0u64;
    for lookup in &r.lookups {
        let bits = r.size(&lookup.axes);
        *by_size.entry(bits).or_insert(0) += 1;
        looked_up += 1 << bits;
    }
    println!(
        "fractions: {:.1} M of 2^{}; look-ups by bits {by_size:?}",
        looked_up as f64 / 1e6,
        Layout::new(r).variables
    );
    println!(
        "{} products, {} monomials, {} equalities",
        r.products.len(),
        r.monomials.len(),
        r.equalities.len()
    );
    Ok(())
}
