//! Where a training step's time goes: every kernel at the sizes that a step runs it with, against what this machine could do
//! at best. `step_floors tiny|micro|full BATCH` prints one JSON line a kernel, then their sum.
//!
//! A kernel's floor is the longer of two: its floating-point operations at the rate of a large product that stays in the
//! cache, and the bytes that it has to move at the rate of copying memory. Both rates are measured first.

use std::collections::BTreeMap;
use std::time::Instant;

use candle_core::{Device, Tensor, Var};
use rayon::prelude::*;
use zk0_smolvla::layout::{policy_layout, EXPERT, VLM};
use zk0_smolvla::memory::KeepFreed;
use zk0_smolvla::model::kernels::attention::attend_to_all;
use zk0_smolvla::model::kernels::gelu::gelu_tanh;
use zk0_smolvla::model::kernels::gradients::backward;
use zk0_smolvla::model::kernels::linear::Linear;
use zk0_smolvla::model::kernels::matrix::{product, Into, Matrix, Threads};
use zk0_smolvla::model::kernels::norm::rms_norm;
use zk0_smolvla::model::kernels::swiglu::swiglu;
use zk0_smolvla::optimizer::{AdamW, AdamWOptions};
use zk0_smolvla::{PolicyConfig, Profile};

/// As in the `zk0` binary.
#[global_allocator]
static ALLOCATOR: zk0_smolvla::memory::Allocator = zk0_smolvla::memory::Allocator;

type Failure = Box<dyn std::error::Error>;

/// What this machine does at best, per second.
struct Rates {
    operations: f64,
    bytes: f64,
}

impl Rates {
    fn measure() -> Self {
        let n = 768;
        let a = vec![0.5f32; n * n];
        let mut out = vec![0.0f32; n * n];
        let seconds = median(9, || {
            let (a, b) = (Matrix::new(&a, n, n), Matrix::new(&a, n, n));
            product(
                a,
                b.transposed(),
                1.0,
                &mut out,
                n,
                Into::Replace,
                Threads::All,
            );
        });
        let operations = 2.0 * (n * n * n) as f64 / seconds;
        let from = vec![1.0f32; 1 << 26];
        let mut to = vec![0.0f32; 1 << 26];
        let seconds = median(5, || {
            let parts = to.par_chunks_mut(1 << 20).zip(from.par_chunks(1 << 20));
            parts.for_each(|(to, from)| to.copy_from_slice(from));
        });
        Self {
            operations,
            bytes: 8.0 * from.len() as f64 / seconds,
        }
    }
}

/// The median time of some runs, after one that is not counted, in seconds.
fn median(runs: usize, mut work: impl FnMut()) -> f64 {
    work();
    let mut seconds: Vec<f64> = (0..runs)
        .map(|_| {
            let started = Instant::now();
            work();
            started.elapsed().as_secs_f64()
        })
        .collect();
    seconds.sort_by(f64::total_cmp);
    seconds[runs / 2]
}

struct Report {
    rates: Rates,
    total: f64,
    floor: f64,
}

impl Report {
    /// Times `work`, which a step does `calls` times, and which takes so many operations and moves so many bytes.
    fn kernel(
        &mut self,
        name: &str,
        calls: usize,
        operations: f64,
        bytes: f64,
        work: impl FnMut(),
    ) {
        let seconds = median(5, work);
        let (by_operations, by_bytes) =
            (operations / self.rates.operations, bytes / self.rates.bytes);
        let floor = by_operations.max(by_bytes);
        let bound = if by_operations > by_bytes {
            "FLOP"
        } else {
            "memory"
        };
        self.total += calls as f64 * seconds;
        self.floor += calls as f64 * floor;
        println!(
            "{}",
            serde_json::json!({
                "bench": name, "ours": calls as f64 * seconds, "peer": calls as f64 * floor, "ratio": floor / seconds,
                "unit": "s/step", "calls": calls, "bound": bound,
            })
        );
    }
}

fn tensor(shape: &[usize]) -> Result<Tensor, Failure> {
    let count = shape.iter().product::<usize>();
    let wave = (0..count).map(|i| (i as f32 * 0.618).sin()).collect();
    Ok(Tensor::from_vec(wave, shape, &Device::Cpu)?)
}

/// Runs a kernel that cannot fail at sizes it was made for.
fn run(done: candle_core::Result<Tensor>) {
    std::hint::black_box(done.expect("sizes agree"));
}

fn linear_maps(report: &mut Report, c: &PolicyConfig, batch: usize) -> Result<(), Failure> {
    let prefix = batch * c.max_prefix_tokens();
    let suffix = batch * c.chunk_size;
    // Linear maps of one size, as often as a step runs them: by part, rows, shape and whether they are trained.
    let mut maps: BTreeMap<(&str, usize, Vec<usize>, bool), usize> = BTreeMap::new();
    for (name, mut shape) in policy_layout(c) {
        let vision = name.contains("vision_model");
        if vision && (name.contains("k_proj") || name.contains("v_proj")) {
            // Part of the product that `q_proj` stands for.
            continue;
        }
        if vision && name.contains("q_proj") {
            shape[0] *= 3;
        }
        let shape = match shape.as_slice() {
            _ if name.contains("embed_tokens") || name.contains("position_embedding") => continue,
            [out, channels, height, width] => vec![*out, channels * height * width],
            [_, _] => shape,
            _ => continue,
        };
        let key_or_value = name.contains("k_proj") || name.contains("v_proj");
        let key = if vision {
            ("vision", batch * c.patches(), shape, false)
        } else if name.contains("connector") {
            ("connector", batch * c.tokens_per_camera(), shape, false)
        } else if name.starts_with(VLM) {
            ("text", prefix, shape, false)
        } else if name.starts_with(EXPERT) && key_or_value && shape[1] != c.expert.width {
            ("expert, cross keys and values", prefix, shape, true)
        } else if name.contains("state_proj") {
            continue;
        } else {
            ("expert", suffix, shape, true)
        };
        let calls = if matches!(key.0, "vision" | "connector") {
            c.cameras
        } else {
            1
        };
        *maps.entry(key).or_default() += calls;
    }
    for ((part, rows, shape, trained), calls) in maps {
        let (out, inner) = (shape[0], shape[1]);
        let (x, w) = (tensor(&[rows, inner])?, tensor(&shape)?);
        let operations = 2.0 * (rows * out * inner) as f64;
        let bytes = 4.0 * (rows * (out + inner) + out * inner) as f64;
        let name = format!("{part}: linear {rows} x {inner} -> {out}");
        let map = Linear::new(w.clone(), None);
        report.kernel(&name, calls, operations, bytes, || run(map.forward(&x)));
        if trained {
            let (x, w) = (Var::from_tensor(&x)?, Var::from_tensor(&w)?);
            let out = Linear::new(w.as_tensor().clone(), None).forward(x.as_tensor())?;
            // Both gradients: each of the three matrices is read, two are written.
            let work = || {
                std::hint::black_box(backward(&out).expect("sizes agree"));
            };
            report.kernel(
                &format!("{name}, backward"),
                calls,
                2.0 * operations,
                2.0 * bytes,
                work,
            );
        }
    }
    Ok(())
}

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [profile, batch] = arguments.as_slice() else {
        return Err("usage: step_floors tiny|micro|full BATCH".into());
    };
    let c = Profile::from_name(profile)?.config();
    let batch: usize = batch.parse()?;
    let _memory = KeepFreed::new();
    let rates = Rates::measure();
    println!(
        "{}",
        serde_json::json!({
            "operations_per_second": rates.operations, "bytes_per_second": rates.bytes,
            "threads": rayon::current_num_threads(),
        })
    );
    let mut report = Report {
        rates,
        total: 0.0,
        floor: 0.0,
    };
    linear_maps(&mut report, &c, batch)?;

    let (patches, width) = (c.patches(), c.vision.width);
    let layers = c.cameras * c.vision.layers;
    let x = tensor(&[batch, patches, 3 * width])?;
    let elements = (batch * patches * width) as f64;
    let scores = (batch * patches * patches) as f64;
    report.kernel(
        "vision: attention",
        layers,
        4.0 * scores * width as f64,
        16.0 * elements,
        || run(attend_to_all(&x, c.vision.heads)),
    );
    let x = tensor(&[batch, patches, c.vision.mlp_width])?;
    let bytes = 8.0 * (batch * patches * c.vision.mlp_width) as f64;
    report.kernel("vision: GELU", layers, 0.0, bytes, || {
        run(gelu_tanh(x.clone()))
    });

    for (part, tokens, width, mlp_width) in [
        (
            "text",
            c.max_prefix_tokens(),
            c.text.width,
            c.text.mlp_width,
        ),
        ("expert", c.chunk_size, c.expert.width, c.expert.mlp_width),
    ] {
        let (gate, gain) = (tensor(&[batch, tokens, mlp_width])?, tensor(&[width])?);
        let x = tensor(&[batch, tokens, width])?;
        let bytes = |width: usize, tensors: f64| 4.0 * tensors * (batch * tokens * width) as f64;
        report.kernel(
            &format!("{part}: SwiGLU"),
            c.text.layers,
            0.0,
            bytes(mlp_width, 3.0),
            || run(swiglu(&gate, &gate)),
        );
        report.kernel(
            &format!("{part}: RMSNorm"),
            2 * c.text.layers + 1,
            0.0,
            bytes(width, 2.0),
            || run(rms_norm(&x, &gain, 1e-5)),
        );
    }

    // AdamW reads gradient, weight and both moments, and writes all but the gradient.
    let trained: usize = zk0_smolvla::layout::expert_layout(&c)
        .values()
        .map(|shape| shape.iter().product::<usize>())
        .sum();
    let variable = Var::from_tensor(&tensor(&[trained])?)?;
    let variables = BTreeMap::from([("weights".to_owned(), variable.clone())]);
    let mut optimizer = AdamW::new(&variables, AdamWOptions::default())?;
    let gradients = variable.as_tensor().sum_all()?.backward()?;
    report.kernel("AdamW", 1, 0.0, 28.0 * trained as f64, || {
        optimizer
            .step(&gradients, 1e-4)
            .map(|_| ())
            .expect("a gradient is there");
    });
    println!(
        "{}",
        serde_json::json!({
            "bench": "sum of the kernels", "ours": report.total, "peer": report.floor,
            "ratio": report.floor / report.total, "unit": "s/step",
        })
    );
    Ok(())
}
