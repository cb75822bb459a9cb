//! Writes inputs of the guest program.
//!
//! `cargo run --release --example inputs -- FOLDER`
//!
//! `micro-1` and `micro-2` are proofs of a claim with so many samples. The others are statements that are too large to prove here, with a
//! proof of random words: the program that `build-guest.sh --unsound` builds takes as many cycles for it as for a true one.

#[path = "../tests/models/mod.rs"]
mod models;

use models::claims::Random;
use models::Models;
use std::error::Error;
use std::fs;
use std::path::Path;
use zk0_argument::expert::argument::{prove::prove, verify};
use zk0_argument::expert::layers::Expert;
use zk0_argument::expert::statement::{Evaluated, Statement};
use zk0_argument::expert::witness::{evaluate, Witness};
use zk0_circuits::model::draw::draw;
use zk0_circuits::model::layout::Layout;
use zk0_circuits::model::linear::bit_limits;
use zk0_circuits::model::spec::Dims;
use zk0_circuits::{Digest, EvalSpec};

/// More words than any of these proofs has.
const WORDS: usize = 1 << 21;

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args().nth(1).ok_or("usage: inputs FOLDER")?;
    let write = |name: &str, statement: &Statement, proof: &[u64]| -> Result<(), Box<dyn Error>> {
        let folder = Path::new(&folder).join(name);
        fs::create_dir_all(&folder)?;
        let bytes = |words: &[u64]| -> Vec<u8> { words.iter().flat_map(|word| word.to_le_bytes()).collect() };
        fs::write(folder.join("0.bin"), bytes(&statement.encode()))?;
        fs::write(folder.join("1.bin"), bytes(proof))?;
        Ok(())
    };
    let micro = EvalSpec::micro();
    for samples in [1, 2] {
        let models = Models::new(&micro, samples, 1);
        let weights = [&models.base, &models.update];
        let (statement, kept) = evaluate(&micro, weights, &models.samples)?;
        let expert = Expert::new(&statement);
        let witness = Witness::new(&statement, &expert, weights, &models.samples, &kept)?;
        let proof = prove(&statement, &expert, &witness).ok_or("too small for a commitment")?;
        verify(&statement, &proof)?;
        println!("micro-{samples}: {} words", proof.len());
        write(&format!("micro-{samples}"), &statement, &proof)?;
    }
    let mut random = Random(1);
    // Each half of a word is below the moduli of KoalaBear and Goldilocks.
    let words: Vec<u64> = (0..WORDS).map(|_| random.bits() & 0x3fff_ffff_3fff_ffff).collect();
    for (name, dims, samples) in [
        ("random-micro-1", Dims::MICRO, 1),
        ("random-full-1", Dims::FULL, 1),
        ("random-full-16", Dims::FULL, 16),
    ] {
        write(name, &statement(&EvalSpec::new(dims), samples), &words)?;
    }
    Ok(())
}

/// A statement about nothing.
fn statement(spec: &EvalSpec, samples: usize) -> Statement {
    let tensors = Layout::new(&spec.dims).tensors.len();
    let limits = bit_limits(spec, tensors).into_iter();
    let scales: Vec<i16> = limits.map(|(least, most)| 12.clamp(least, most)).collect();
    let sample = |index: usize| Evaluated {
        // Recordings have a few lengths of instructions.
        prefix: spec.dims.max_prefix as usize - index % 4,
        frames: spec.dims.chunk as usize - index % 3,
        draw: draw(spec, &Digest([7; 32]), index as u32, samples as u32),
        losses: [1 << 40, 1 << 39],
    };
    Statement {
        spec: spec.clone(),
        weights: [Digest([1; 32]), Digest([2; 32])],
        scales: [scales.clone(), scales],
        samples: (0..samples).map(sample).collect(),
    }
}
