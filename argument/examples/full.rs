//! Proves the losses of two random models natively, and verifies them: `full SIZE [SAMPLES]`, where SIZE is micro, middle, quarter (a
//! quarter of the layers) or full.
//! It prints the seconds of each step, and the most memory that was used up to then.

use std::cell::Cell;
use std::error::Error;
use std::fs;
use std::time::Instant;
use zk0_argument::claim::{Blind, Cost};
use zk0_argument::expert::argument::{prove::prove, verify};
use zk0_argument::expert::evaluation::layers::Expert;
use zk0_argument::expert::prover_values::{evaluate, Common, SampleValues};
use zk0_argument::prove::progress::Phase;
use zk0_argument::transcript::Refused;
use zk0_circuits::model::draw::draw;
use zk0_circuits::model::layout::{expert_tensors, Layout};
use zk0_circuits::model::sample::SampleParts;
use zk0_circuits::model::spec::Dims;
use zk0_circuits::{Digest, EvalSpec, QuantisedWeights, Sample};

/// Numbers that look random.
struct Random(u64);

impl Random {
    /// Uniform between −1 and 1.
    fn unit(&mut self) -> f32 {
        self.0 = self
            .0
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        (self.0 >> 40) as f32 / (1 << 23) as f32 - 1.0
    }

    fn list(&mut self, count: usize, scale: f32) -> Vec<f32> {
        (0..count).map(|_| scale * self.unit()).collect()
    }
}

fn weights(spec: &EvalSpec, seed: u64, velocity: f32) -> Result<QuantisedWeights, Box<dyn Error>> {
    let mut random = Random(seed);
    let tensors = expert_tensors(&spec.dims).into_iter().map(|tensor| {
        let count = tensor.shape.iter().product();
        let mut values = match tensor.shape[..] {
            [_, columns] => random.list(count, 1.7 / (columns as f32).sqrt()),
            _ => random.list(count, 0.1),
        };
        if tensor.name.ends_with("norm.weight") {
            values.iter_mut().for_each(|value| *value += 1.0);
        }
        if tensor.name.starts_with("model.action_out_proj") {
            values.iter_mut().for_each(|value| *value *= velocity);
        }
        (tensor.name, values)
    });
    let tensors: std::collections::HashMap<String, Vec<f32>> = tensors.collect();
    Ok(QuantisedWeights::quantise(spec, |name| {
        tensors.get(name).map(Vec::as_slice)
    })?)
}

fn sample(spec: &EvalSpec, random: &mut Random) -> Result<Sample, Box<dyn Error>> {
    let dims = &spec.dims;
    let (chunk, width) = (dims.chunk as usize, dims.max_action_dim as usize);
    let each = dims.max_prefix as usize * dims.kv_width();
    let cache = (0..dims.layers).map(|_| (random.list(each, 2.0), random.list(each, 2.0)));
    let cache: Vec<_> = cache.collect();
    let cache: Vec<_> = cache.iter().map(|(k, v)| (&k[..], &v[..])).collect();
    let mut actions = random.list(chunk * width, 2.0);
    for frame in actions.chunks_exact_mut(width) {
        frame[dims.action_dim as usize..].fill(0.0);
    }
    let parts = SampleParts {
        cache: &cache,
        actions: &actions,
        is_pad: &vec![false; chunk],
    };
    Ok(Sample::quantise(spec, parts)?)
}

/// Prints how long a step took, and the most memory up to now.
fn measured<T>(what: &str, step: impl FnOnce() -> T) -> T {
    let begin = Instant::now();
    let result = step();
    println!("{what}: {:.2?}, peak {}", begin.elapsed(), peak());
    result
}

/// The gigabytes that are mapped of files without a name: what is committed to.
fn in_files() -> f64 {
    let maps = fs::read_to_string("/proc/self/maps").unwrap_or_default();
    let bytes = maps.lines().filter_map(|line| {
        let range = line.strip_suffix("(deleted)")?.split(' ').next()?;
        let (from, to) = range.split_once('-')?;
        let address = |text| u64::from_str_radix(text, 16).ok();
        address(to)?.checked_sub(address(from)?)
    });
    bytes.sum::<u64>() as f64 / 1e9
}

/// The most memory up to now.
fn peak() -> String {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    peak.unwrap_or_default().trim().to_owned()
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let dims = match arguments.next().as_deref() {
        Some("micro") => Dims::MICRO,
        Some("middle") => Dims {
            expert_width: 192,
            expert_mlp: 512,
            heads: 4,
            kv_heads: 2,
            head_dim: 32,
            layers: 4,
            max_prefix: 49,
            chunk: 14,
            ..Dims::FULL
        },
        Some("quarter") => Dims {
            layers: 4,
            ..Dims::FULL
        },
        Some("full") => Dims::FULL,
        _ => return Err("micro, middle, quarter or full".into()),
    };
    let count = arguments.next().map_or(Ok(1), |n| n.parse::<u32>())?;
    let spec = EvalSpec::new(dims);
    let begin = Instant::now();
    let last = Cell::new(begin);
    // What the shares of the phases follow from.
    let tell = |phase: Phase, share: f64| {
        let seconds = last.replace(Instant::now()).elapsed().as_secs_f64();
        let all = phase.of_all(share);
        println!(
            "  {phase:?} {share:.3}, all {all:.3}: {seconds:.3} s, peak {}, {:.3} GB in files",
            peak(),
            in_files()
        );
    };
    let models = measured("weights", || {
        Ok::<_, Box<dyn Error>>([weights(&spec, 1, 2.0)?, weights(&spec, 1, 0.5)?])
    })?;
    let models = [&models[0], &models[1]];
    let mut random = Random(2);
    let samples = (0..count).map(|number| {
        let drawn = draw(&spec, &Digest([3; 32]), number, count);
        Ok((sample(&spec, &mut random)?, drawn))
    });
    let samples = samples.collect::<Result<Vec<_>, Box<dyn Error>>>()?;
    last.set(Instant::now());
    let statement = measured("evaluation", || {
        evaluate(Digest([4; 32]), &spec, models, &samples, &tell)
    })?;
    println!(
        "losses {:?}",
        statement
            .samples
            .iter()
            .map(|s| s.losses)
            .collect::<Vec<_>>()
    );
    let expert = Expert::new(&statement);
    println!("bits of sources {:?}", expert.source_bits);
    println!("expected {:?}", Cost::of(&spec, count, false));
    let common = Common::new(&statement, models);
    let folder = tempfile::tempdir()?;
    let sample_values = |number: usize| {
        measured("values of a sample", || {
            SampleValues::of(&statement, &common, number, models, &samples)
        })
    };
    let proof = measured("proof", || {
        let blind = Blind::new([5; 32]);
        prove(
            &statement,
            &common,
            &blind,
            Some(folder.path()),
            &tell,
            sample_values,
        )
    })?;
    println!("{} bytes", 8 * proof.len());
    let verified = measured("verifier", || verify(&statement, &proof))?;
    let published = verified.published;
    println!(
        "{} claims are left, {} bytes",
        published.claims.len(),
        8 * published.words().len()
    );
    measured("claims", || {
        let layout = Layout::new(&spec.dims);
        let sums = |model: usize| {
            let tensor = |number| Ok::<_, Refused>(models[model].tensor(&layout, number).0);
            published.sums(&expert, model, layout.tensors.len(), tensor)
        };
        let (base, update) = rayon::join(|| sums(0), || sums(1));
        published.check(&expert, [&base?, &update?])
    })?;
    println!("all of it: {:.2?}", begin.elapsed());
    Ok(())
}
