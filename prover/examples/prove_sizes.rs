//! zk0's side of `scripts/compare-ezkl`: claims over two samples for every model of a list, in modes `direct` and `succinct`:
//! `cargo run --release --workspace --example prove_sizes -- SIZES.json OUTPUT.jsonl [--most-cycles N] [--execute-only] [MODEL…]`
//!
//! Each claim is executed first, and a JSON line states what that took. Then each claim of at most N cycles is proven, and another line states
//! all of it. The last line of a model and mode counts. What has such a line is not measured again. Without a MODEL, all of them are taken.
//!
//! The input of a claim is made in a process of its own, so that its memory is measured by itself and is free again before SP1 starts. In mode
//! `succinct` that process makes the argument.

use serde_json::{json, Value};
use sp1_verifier::compressed::SP1CompressedVerifierRaw;
use std::env;
use std::error::Error;
use std::fs::{self, File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};
use zk0_circuits::claim::program::verifying_key;
use zk0_circuits::model::layout::expert_tensors;
use zk0_circuits::model::spec::Dims;
use zk0_circuits::{Claim, EvalSpec, Mode};
use zk0_prover::machine::{peak_memory, Device, DeviceKind, ProverLock};
use zk0_prover::measure::DirectMode;
use zk0_prover::program::{elf, synthetic, Executor, GuestInput, PreparedClaim};
use zk0_prover::prove::Sp1Prover;
use zk0_verifier::check_weight_claims;
use zk0_weights::Format;

const USAGE: &str =
    "usage: prove_sizes SIZES.json OUTPUT.jsonl [--most-cycles N] [--execute-only] [MODEL…]";
/// The first argument of the process that makes an input.
const PREPARE: &str = "--prepare";
const MODES: [Mode; 2] = [Mode::Direct, Mode::Succinct];
/// The fewest samples that a claim may have.
const SAMPLES: u32 = 2;
/// Claims of more guest cycles are not proven, unless the caller states another number. On two cores, a proof of as many takes half an hour.
const MOST_CYCLES: u64 = 20_000_000;
/// Claims that need more guest cycles in any case are not even executed, which would take longer than a quarter of an hour.
const MOST_EXECUTED: u64 = 10_000_000_000;

type Failure = Box<dyn Error>;

struct Options {
    sizes: Vec<Value>,
    output: PathBuf,
    most_cycles: u64,
    execute_only: bool,
    models: Vec<String>,
}

/// A claim of one model in one mode.
struct Work {
    model: String,
    /// As the list of models has them.
    dims: Value,
    mode: Mode,
}

#[tokio::main]
async fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    if let [first, dims, mode, folder] = &arguments[..] {
        if first == PREPARE {
            return prepare(
                &serde_json::from_str(dims)?,
                mode.parse()?,
                Path::new(folder),
            );
        }
    }
    let options = Options::read(arguments)?;
    let executor = Executor::new().await?;
    let mut to_prove = Vec::new();
    for work in options.work()? {
        let (mut line, input) = execute(&executor, &work).await?;
        let cycles = line["cycles"].as_u64().unwrap_or(u64::MAX);
        let most = options.most_cycles;
        let why = match &input {
            None => None,
            Some(_) if options.execute_only => Some("executed only".into()),
            Some(_) if cycles > most => Some(format!("more than {most} cycles")),
            Some(_) => Some("executed, and not proven yet".into()),
        };
        if let Some(why) = why {
            line["not_proven"] = json!(why);
        }
        append(&options.output, &line)?;
        if let Some(input) = input {
            if !options.execute_only && cycles <= most {
                to_prove.push((work, line, input));
            }
        }
    }
    if to_prove.is_empty() {
        return Ok(());
    }
    let device = Device::find(DeviceKind::Cpu)?;
    let lock = ProverLock::acquire(&ProverLock::default_path(), Duration::ZERO)?;
    let begin = Instant::now();
    let prover = Sp1Prover::start(device, lock.into()).await?;
    let setup = begin.elapsed().as_secs_f64();
    for (work, mut line, input) in to_prove {
        let Work { model, mode, .. } = &work;
        eprintln!("{model}, mode {mode}: proving");
        restart_peak_memory()?;
        let begin = Instant::now();
        let proof = prover.prove_compressed(&input).await?;
        let prove = begin.elapsed().as_secs_f64();
        let begin = Instant::now();
        SP1CompressedVerifierRaw::verify_with_public_values(
            &proof.bytes,
            &proof.public_values,
            verifying_key(*mode),
        )?;
        let verify = begin.elapsed().as_secs_f64();
        let cycles = line["cycles"].as_u64().unwrap_or_default();
        if let Some(line) = line.as_object_mut() {
            line.remove("not_proven");
        }
        line["setup_seconds"] = json!(setup);
        line["prove_seconds"] = json!(prove);
        line["verify_seconds"] = json!(verify);
        line["proof_bytes"] = json!(proof.bytes.len());
        line["peak_memory_bytes"] = json!(peak_memory());
        line["cycles_per_second"] = json!(cycles as f64 / prove);
        append(&options.output, &line)?;
    }
    Ok(())
}

impl Options {
    fn read(arguments: Vec<String>) -> Result<Self, Failure> {
        let mut arguments = arguments.into_iter();
        let sizes = arguments.next().ok_or(USAGE)?;
        let output = arguments.next().ok_or(USAGE)?;
        let (mut most_cycles, mut execute_only, mut models) = (MOST_CYCLES, false, Vec::new());
        while let Some(argument) = arguments.next() {
            match argument.as_str() {
                "--most-cycles" => {
                    let number = arguments.next().ok_or(USAGE)?;
                    let wrong = |_| format!("--most-cycles needs a whole number, not {number}");
                    most_cycles = number.parse().map_err(wrong)?;
                }
                "--execute-only" => execute_only = true,
                option if option.starts_with('-') => {
                    return Err(format!("there is no option {option}; {USAGE}").into())
                }
                _ => models.push(argument),
            }
        }
        Ok(Self {
            sizes: serde_json::from_slice(&fs::read(sizes)?)?,
            output: output.into(),
            most_cycles,
            execute_only,
            models,
        })
    }

    /// The claims that have no line yet.
    fn work(&self) -> Result<Vec<Work>, Failure> {
        let lines = match self.output.exists() {
            true => fs::read_to_string(&self.output)?,
            false => String::new(),
        };
        let lines: Vec<Value> = lines
            .lines()
            .map(serde_json::from_str)
            .collect::<Result<_, _>>()?;
        for model in &self.models {
            if !self.sizes.iter().any(|entry| entry["model"] == **model) {
                return Err(format!("no model is called {model}").into());
            }
        }
        let mut work = Vec::new();
        for entry in &self.sizes {
            let model = entry["model"].as_str().ok_or("a model has no name")?;
            if !self.models.is_empty() && !self.models.iter().any(|wanted| wanted == model) {
                continue;
            }
            for mode in MODES {
                let is_own = |line: &&Value| {
                    line["side"] == "zk0"
                        && line["model"] == model
                        && line["mode"] == mode.to_string()
                        && line["samples"] == SAMPLES
                };
                if !lines.iter().rfind(is_own).is_some_and(|l| self.is_done(l)) {
                    let (model, dims) = (model.to_owned(), entry["dims"].clone());
                    work.push(Work { model, dims, mode });
                }
            }
        }
        Ok(work)
    }

    /// Whether a line states all that these options ask for.
    fn is_done(&self, line: &Value) -> bool {
        let is_final = line["prove_seconds"].is_number() || line["cycles"].is_null();
        let cycles = line["cycles"].as_u64();
        is_final || self.execute_only || cycles.is_some_and(|cycles| cycles > self.most_cycles)
    }
}

/// Makes the input of a claim and executes it. There is no input where the line states that there can be no claim, or that it is too long.
async fn execute(executor: &Executor, work: &Work) -> Result<(Value, Option<GuestInput>), Failure> {
    let (model, mode, dims) = (&work.model, &work.mode, read_dims(&work.dims)?);
    let weights: usize = expert_tensors(&dims)
        .iter()
        .map(|tensor| tensor.len())
        .sum();
    let mut line = json!({
        "side": "zk0", "mode": mode.to_string(), "model": model, "weights": weights, "samples": SAMPLES,
    });
    let products = DirectMode {
        weights: weights as u64,
        samples: SAMPLES,
        chunk: dims.chunk.into(),
    };
    if *mode == Mode::Direct && products.cycles() > MOST_EXECUTED {
        line["not_proven"] = json!(format!(
            "not executed: the products alone take {} cycles",
            products.cycles()
        ));
        return Ok((line, None));
    }
    eprintln!("{model}, mode {mode}: making the input");
    let folder = tempfile::tempdir()?;
    let made = Command::new(env::current_exe()?)
        .arg(PREPARE)
        .arg(work.dims.to_string())
        .arg(mode.to_string())
        .arg(folder.path())
        .stderr(Stdio::inherit())
        .output()?;
    if !made.status.success() {
        let status = made.status;
        return Err(format!("{model}, mode {mode}: the input was not made ({status})").into());
    }
    let made: Value = serde_json::from_slice(&made.stdout)?;
    let fields = made.as_object().ok_or("the process printed no object")?;
    for (name, value) in fields {
        line[name] = value.clone();
    }
    let read = |name: &str| fs::read(folder.path().join(name));
    let buffers: Vec<Vec<u8>> = borsh::from_slice(&read("input.bin")?)?;
    let input = GuestInput::new(*mode, buffers);
    eprintln!("{model}, mode {mode}: executing");
    let begin = Instant::now();
    let run = executor.execute(elf(*mode), &input.buffers).await?;
    line["execute_seconds"] = json!(begin.elapsed().as_secs_f64());
    line["input_bytes"] = json!(input.bytes());
    line["cycles"] = json!(run.cycles);
    line["gas"] = json!(run.gas);
    if *mode == Mode::Succinct {
        let claim: Claim = borsh::from_slice(&run.public_values)?;
        let claimed = claim.weight_check.ok_or("the claim has no weight check")?;
        let open = |name: &str| File::open(folder.path().join(name));
        let (format, left) = (
            Format::new(&EvalSpec::new(dims))?,
            read("weight_check.bin")?,
        );
        let (base, update) = (open("base")?, open("update")?);
        let begin = Instant::now();
        check_weight_claims(&format, &claimed, &left, base, update)?;
        line["weight_check_seconds"] = json!(begin.elapsed().as_secs_f64());
        line["weight_check_bytes"] = json!(left.len());
    }
    Ok((line, Some(input)))
}

/// Makes the input of a claim from a seed, and what belongs to it. Prints what that took as JSON.
fn prepare(dims: &Value, mode: Mode, folder: &Path) -> Result<(), Failure> {
    let spec = EvalSpec::new(read_dims(dims)?);
    let private = synthetic::private_input(&spec, mode, SAMPLES, 1)?;
    let blind = synthetic::blind(1);
    restart_peak_memory()?;
    let begin = Instant::now();
    let prepared = PreparedClaim::of(mode, &private, &blind, Some(folder), &mut |_| {})?;
    let (seconds, peak) = (begin.elapsed().as_secs_f64(), peak_memory());
    let write = |name: &str, bytes: &[u8]| fs::write(folder.join(name), bytes);
    write("input.bin", &borsh::to_vec(&prepared.input.buffers)?)?;
    if mode != Mode::Succinct {
        println!("{}", json!({}));
        return Ok(());
    }
    let format = Format::new(&spec)?;
    write("weight_check.bin", &prepared.weight_check)?;
    write("base", &format.write(&private.base))?;
    write("update", &format.write(&private.update))?;
    let line = json!({"argument_seconds": seconds, "argument_peak_memory_bytes": peak});
    println!("{line}");
    Ok(())
}

/// From here on, the peak of this process's memory is counted anew.
fn restart_peak_memory() -> std::io::Result<()> {
    fs::write("/proc/self/clear_refs", "5")
}

fn append(output: &Path, line: &Value) -> std::io::Result<()> {
    println!("{line}");
    let mut file = OpenOptions::new().create(true).append(true).open(output)?;
    writeln!(file, "{line}")
}

/// Reads the dimensions field by field.
fn read_dims(value: &Value) -> Result<Dims, String> {
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
