//! zk0's side of `scripts/compare-ezkl`: proves a claim over two samples for every model of a list, in each mode, one JSON
//! line each: `cargo run --release --workspace --example prove_sizes SIZES.json OUTPUT.jsonl MODEL…`
//!
//! A model that has a line in OUTPUT.jsonl already is not proven again.

use serde_json::{json, Value};
use sp1_verifier::compressed::SP1CompressedVerifierRaw;
use std::env;
use std::error::Error;
use std::fs::{self, OpenOptions};
use std::io::Write;
use std::path::Path;
use std::time::{Duration, Instant};
use zk0_circuits::claim::hinted_input::HintedInput;
use zk0_circuits::claim::program::verifying_key;
use zk0_circuits::model::layout::expert_tensors;
use zk0_circuits::model::spec::Dims;
use zk0_circuits::{EvalSpec, Mode};
use zk0_prover::machine::{peak_memory, Device, DeviceKind, ProverLock};
use zk0_prover::program::{elf, synthetic, Executor, Prepared};
use zk0_prover::prove::Sp1Prover;

const USAGE: &str = "usage: prove_sizes SIZES.json OUTPUT.jsonl MODEL…";

#[tokio::main]
async fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = env::args().skip(1);
    let sizes = arguments.next().ok_or(USAGE)?;
    let output = arguments.next().ok_or(USAGE)?;
    let sizes: Vec<Value> = serde_json::from_slice(&fs::read(sizes)?)?;
    let mut work = Vec::new();
    for model in arguments {
        let entry = sizes.iter().find(|entry| entry["model"] == *model);
        let dims = dims(&entry.ok_or(format!("no model is called {model}"))?["dims"])?;
        for mode in Mode::ALL {
            if !is_done(Path::new(&output), &model, mode)? {
                work.push((model.clone(), dims, mode));
            }
        }
    }
    if work.is_empty() {
        return Ok(());
    }
    let executor = Executor::new().await?;
    let device = Device::find(DeviceKind::Cpu)?;
    let lock = ProverLock::acquire(&ProverLock::default_path(), Duration::ZERO)?;
    let begin = Instant::now();
    let prover = Sp1Prover::start(device, lock.into()).await?;
    let setup = begin.elapsed();
    for (model, dims, mode) in work {
        eprintln!("zk0, mode {mode}: {model}");
        let private = synthetic::private_input(&EvalSpec::new(dims), mode, 2, 1)?;
        let input = Prepared::of(mode, &private, None, &mut |_| {})?.input;
        let run = executor.execute(elf(mode), &input.buffers).await?;
        // In mode `checked`, the verifier also projects both sets of weights.
        let mut hinted = match mode {
            Mode::Direct | Mode::Succinct => None,
            Mode::Checked => Some(HintedInput::of(&private)?),
        };
        fs::write("/proc/self/clear_refs", "5")?; // The peak of memory is counted from here on.
        let begin = Instant::now();
        let proof = prover.prove_compressed(&input).await?;
        let prove = begin.elapsed();
        let begin = Instant::now();
        SP1CompressedVerifierRaw::verify_with_public_values(
            &proof.bytes,
            &proof.public_values,
            verifying_key(mode),
        )?;
        if let Some(hinted) = &mut hinted {
            let seed = hinted.seed;
            hinted.project(seed, [&private.base, &private.update])?;
        }
        let verify = begin.elapsed();
        let weights: usize = expert_tensors(&dims).iter().map(|t| t.len()).sum();
        let line = json!({
            "side": "zk0", "mode": mode.to_string(), "model": model, "weights": weights,
            "cycles": run.cycles, "gas": run.gas,
            "setup_seconds": setup.as_secs_f64(), "prove_seconds": prove.as_secs_f64(),
            "verify_seconds": verify.as_secs_f64(), "proof_bytes": proof.bytes.len(),
            "peak_memory_bytes": peak_memory(), "cycles_per_second": run.cycles as f64 / prove.as_secs_f64(),
        });
        let mut file = OpenOptions::new().create(true).append(true).open(&output)?;
        writeln!(file, "{line}")?;
        println!("{line}");
    }
    Ok(())
}

/// Reads the dimensions field by field.
fn dims(value: &Value) -> Result<Dims, String> {
    let field = |name: &str| {
        let number = value[name]
            .as_u64()
            .and_then(|number| number.try_into().ok());
        number.ok_or(format!("dimension {name} is missing or is not a number"))
    };
    Ok(Dims {
        expert_width: field("expert_width")?,
        expert_mlp: field("expert_mlp")?,
        heads: field("heads")?,
        kv_heads: field("kv_heads")?,
        head_dim: field("head_dim")?,
        layers: field("layers")?,
        self_attn_every: field("self_attn_every")?,
        chunk: field("chunk")?,
        max_action_dim: field("max_action_dim")?,
        action_dim: field("action_dim")?,
        max_prefix: field("max_prefix")?,
    })
}

fn is_done(output: &Path, model: &str, mode: Mode) -> Result<bool, Box<dyn Error>> {
    let lines = match output.exists() {
        true => fs::read_to_string(output)?,
        false => String::new(),
    };
    for line in lines.lines() {
        let line: Value = serde_json::from_str(line)?;
        if line["side"] == "zk0" && line["model"] == *model && line["mode"] == mode.to_string() {
            return Ok(true);
        }
    }
    Ok(false)
}
