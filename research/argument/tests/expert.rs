//! The expert's argument: what the evaluation computes is accepted, and what is changed is refused.

mod models;

use models::Models;
use std::time::Instant;
use zk0_argument::expert::argument::{prove::prove, verify};
use zk0_argument::expert::layers::Expert;
use zk0_argument::expert::witness::{evaluate, Witness};
use zk0_circuits::EvalSpec;

#[test]
fn an_evaluation_is_accepted() {
    let models = Models::new(&EvalSpec::micro(), 2, 1);
    let begin = Instant::now();
    let weights = [&models.base, &models.update];
    let (statement, kept) = evaluate(&models.spec, weights, &models.samples).unwrap();
    let expert = Expert::new(&statement);
    let r = &expert.builder.relations;
    println!(
        "{} tensors, {} products, {} monomials, {} lookups, source bits {:?}",
        r.tensors.len(), r.products.len(), r.monomials.len(), r.lookups.len(), expert.source_bits
    );
    let witness = Witness::new(&statement, &expert, weights, &models.samples, &kept).unwrap();
    println!("witness after {:.2?}", begin.elapsed());
    let proof = prove(&statement, &expert, &witness).unwrap();
    println!("proof of {} words after {:.2?}", proof.len(), begin.elapsed());
    let published = verify(&statement, &proof).unwrap();
    println!("verified after {:.2?}, {} claims left", begin.elapsed(), published.claims.len());
    published.holds(&witness.weights, &witness.tables).unwrap();
}
