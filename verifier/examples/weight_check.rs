//! Measures how long the verifier's half of mode `checked` takes at full size, and how much memory it needs.
//!
//! `cargo run --release -p zk0-verifier --example weight_check` writes two sets of random full-size weights (197 MB each) to a
//! temporary folder, projects both, and prints one JSON line. `peer` is the time that it may take: one second.

use std::error::Error;
use std::fs::{self, File};
use std::path::Path;
use std::time::Instant;
use zk0_circuits::model::spec::Dims;
use zk0_circuits::{Digest, EvalSpec, GuestWeights, WeightCheck};
use zk0_protocol::Refusal;
use zk0_verifier::check_projections;
use zk0_weights::{Format, Tensor, WeightsError};

fn main() -> Result<(), Box<dyn Error>> {
    let format = Format::new(&EvalSpec::new(Dims::FULL))?;
    let folder = std::env::temp_dir().join(format!("zk0-weight-check-{}", std::process::id()));
    fs::create_dir_all(&folder)?;
    let result = measure(&format, &folder);
    fs::remove_dir_all(&folder)?;
    result
}

fn measure(format: &Format, folder: &Path) -> Result<(), Box<dyn Error>> {
    let paths = [folder.join("base"), folder.join("update")];
    for (seed, path) in paths.iter().enumerate() {
        write(format, path, seed as u32)?;
    }
    let nothing = GuestWeights {
        parameters: Digest::default(),
        projections: Digest::default(),
    };
    let claimed = WeightCheck {
        seed: Digest([7; 32]),
        base: nothing,
        update: nothing,
    };
    let mut best = f64::MAX;
    for _ in 0..3 {
        let [base, update] = [File::open(&paths[0])?, File::open(&paths[1])?];
        let begin = Instant::now();
        match check_projections(format, &claimed, base, update) {
            // Nobody claimed these weights, so the comparison fails. The comparison comes last, after all the work.
            Err(Refusal::OtherProducts { .. }) => {}
            other => return Err(format!("unexpected: {other:?}").into()),
        }
        best = best.min(begin.elapsed().as_secs_f64());
    }
    let status = fs::read_to_string("/proc/self/status")?;
    let peak = status.lines().find_map(|line| {
        let kilobytes = line.strip_prefix("VmHWM:")?.trim().strip_suffix(" kB")?;
        kilobytes.parse::<u64>().ok()
    });
    println!(
        r#"{{"bench":"weight-check-full","ours":{best:.3},"peer":1.0,"ratio":{:.2},"unit":"s","peak_resident_bytes":{}}}"#,
        1.0 / best,
        peak.unwrap_or(0) * 1024,
    );
    Ok(())
}

/// Makes a file of random weights with the magnitudes of a trained model.
fn write(format: &Format, path: &Path, seed: u32) -> Result<(), Box<dyn Error>> {
    let mut state = 0x9e37_79b9 ^ seed;
    let mut next = || {
        state ^= state << 13;
        state ^= state >> 17;
        state ^= state << 5;
        (state % 65_535) as i32 - 32_767
    };
    let weights = format.assemble(|index| {
        let (_, most) = format.limits()[index];
        let mut values: Vec<i16> = (0..format.tensors()[index].len())
            .map(|_| next() as i16)
            .collect();
        // The largest magnitude fits no finer scale.
        values[0] = i16::MAX;
        Ok::<_, WeightsError>(Tensor {
            values,
            bits: most.min(18),
        })
    })?;
    fs::write(path, format.write(&weights))?;
    Ok(())
}
