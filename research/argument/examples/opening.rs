//! Writes a proof of an opening, for measuring its verifier: `opening FOLDER HEIGHT RATE_BITS WIDTH…`.

use std::error::Error;
use std::path::PathBuf;
use std::time::Instant;
use std::{env, fs};
use zk0_argument::commitment::prove::{open, Committed};
use zk0_argument::commitment::{Parameters, Rate};
use zk0_argument::field::Goldilocks;
use zk0_argument::hash::Digest;
use zk0_argument::transcript::{Challenges, Prover};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = env::args().skip(1);
    let folder = PathBuf::from(arguments.next().ok_or("FOLDER")?);
    let numbers: Vec<u8> = arguments.map(|n| n.parse()).collect::<Result<_, _>>()?;
    let rate = [Rate::Half, Rate::Quarter, Rate::Eighth, Rate::Sixteenth][numbers[1] as usize - 1];
    let parameters = Parameters::new(numbers[0] as u32, rate).ok_or("HEIGHT is 8 to 24")?;
    let mut prover = Prover::new(&Digest([1, 2, 3, 4]));
    let begin = Instant::now();
    let mut segments = vec![];
    for &width in &numbers[2..] {
        let rows = (0..(width as i64) << parameters.variables())
            .map(|i| Goldilocks::from_i64(i.wrapping_mul(0x9E3779B97F4A7C1)))
            .collect();
        segments.push(Committed::new(
            &mut prover,
            &parameters,
            rows,
            width as usize,
        ));
    }
    eprintln!("committed after {:.1?}", begin.elapsed());
    let point = prover.challenges(parameters.variables());
    open(
        &mut prover,
        &parameters,
        &segments.iter().collect::<Vec<_>>(),
        &point,
    );
    eprintln!("opened after {:.1?}", begin.elapsed());
    let proof: Vec<u8> = prover
        .finish()
        .iter()
        .flat_map(|word| word.to_le_bytes())
        .collect();
    eprintln!("{} bytes", proof.len());
    fs::create_dir_all(&folder)?;
    fs::write(folder.join("0.bin"), &numbers)?;
    fs::write(folder.join("1.bin"), &proof)?;
    Ok(())
}
