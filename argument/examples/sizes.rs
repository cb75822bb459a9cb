//! Prints how large an argument is at SmolVLA's full size: `sizes [SAMPLES]`.

use std::env;
use std::error::Error;
use zk0_argument::expert::evaluation::layers::Expert;
use zk0_argument::expert::sizes::Sizes;
use zk0_argument::expert::statement::{EvaluatedSample, Statement};
use zk0_argument::layout::LookupLayout;
use zk0_argument::relation::{Atom, Count, Factor, Relations};
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
        EvaluatedSample {
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
        LookupLayout::new(r).variables
    );
    println!(
        "{} products, {} monomials, {} equalities",
        r.products.len(),
        r.monomials.len(),
        r.equalities.len()
    );
    println!("at most {} sums and claims", claims(r));
    Ok(())
}

/// How many sums and claims the terms of all relations name, if no two are the same.
fn claims(r: &Relations) -> usize {
    let views = |number: usize| r.virtuals[number].views.len();
    let of_atom = |atom: Atom| match atom {
        Atom::One | Atom::Public(_) => 0,
        Atom::Virtual(number) => views(number),
        Atom::Summed(number) => views(r.sums[number].of),
        Atom::Product(_) | Atom::Monomials(_) => 1,
    };
    let of_factor = |factor: &Factor| match factor {
        Factor::Public(_) => 0,
        Factor::Virtual(number) => views(*number),
        Factor::Product(_) => 1,
    };
    let entries = r.lookups.iter().flat_map(|lookup| lookup.entry.iter());
    let linear = entries.chain(r.equalities.iter().map(|equality| &equality.linear));
    let counts = r.lookups.iter().map(|lookup| match lookup.count {
        Count::Offered(number) => views(number),
        _ => 0,
    });
    let products = r.products.iter().map(|p| views(p.left) + views(p.right));
    let terms = r.monomials.iter().flat_map(|monomials| &monomials.terms);
    let factors = terms.flat_map(|(_, factors)| factors).map(of_factor);
    let linear = linear.flatten().map(|term| of_atom(term.atom));
    linear.chain(counts).chain(products).chain(factors).sum()
}
