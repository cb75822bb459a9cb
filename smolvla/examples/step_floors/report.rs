//! What the machine can do at best, and a line for each kernel that is timed against it.

use std::time::Instant;

use candle_core::{Device, Tensor, Var};
use rayon::prelude::*;
use zk0_smolvla::policy::model::kernels::gradients::backward;
use zk0_smolvla::policy::model::kernels::matrix::{product, Into, StridedMatrix, Threads};

use crate::Failure;

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
            let (a, b) = (StridedMatrix::new(&a, n, n), StridedMatrix::new(&a, n, n));
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

/// Returns the median time of some runs in seconds. One run before them is not counted.
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

/// The least work that a kernel has to do.
#[derive(Clone, Copy, Default)]
pub struct Least {
    /// Floating-point operations.
    pub operations: f64,
    /// How many numbers of four bytes are read or written.
    pub numbers: f64,
}

impl Least {
    /// The work of moving this many numbers, with next to no computation.
    pub fn moving(numbers: usize) -> Self {
        Self {
            numbers: numbers as f64,
            ..Self::default()
        }
    }

    /// The same work, this many times.
    pub fn times(self, factor: f64) -> Self {
        Self {
            operations: factor * self.operations,
            numbers: factor * self.numbers,
        }
    }
}

/// Prints one line for each kernel.
pub struct Report {
    rates: Rates,
    total: f64,
    floor: f64,
}

impl Report {
    /// Measures what the machine can do.
    pub fn begin() -> Self {
        let rates = Rates::measure();
        println!(
            "{}",
            serde_json::json!({
                "operations_per_second": rates.operations, "bytes_per_second": rates.bytes,
                "threads": rayon::current_num_threads(),
            })
        );
        Self {
            rates,
            total: 0.0,
            floor: 0.0,
        }
    }

    /// Times `work`, which a step does `calls` times.
    pub fn kernel(&mut self, name: &str, calls: usize, least: Least, work: impl FnMut()) {
        let seconds = median(5, work);
        let by_operations = least.operations / self.rates.operations;
        let by_bytes = 4.0 * least.numbers / self.rates.bytes;
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

    /// Times `work`, and then what takes gradients back through its result to all variables in it. That part has to do at least
    /// `back`.
    pub fn trained(
        &mut self,
        name: &str,
        calls: usize,
        (least, back): (Least, Least),
        work: impl Fn() -> Result<Tensor, Failure>,
    ) -> Result<(), Failure> {
        let out = work()?;
        self.kernel(name, calls, least, || run(work()));
        self.kernel(&format!("{name}, backward"), calls, back, || {
            std::hint::black_box(backward(&out).expect("it worked before"));
        });
        Ok(())
    }

    /// Prints the sum.
    pub fn end(self) {
        println!(
            "{}",
            serde_json::json!({
                "bench": "sum of the kernels", "ours": self.total, "peer": self.floor,
                "ratio": self.floor / self.total, "unit": "s/step",
            })
        );
    }
}

/// Runs a kernel that cannot fail at sizes it was made for.
pub fn run<E: std::fmt::Debug>(done: Result<Tensor, E>) {
    std::hint::black_box(done.expect("sizes agree"));
}

/// Makes a tensor of some numbers.
pub fn tensor(shape: &[usize]) -> Result<Tensor, Failure> {
    let count = shape.iter().product::<usize>();
    let wave = (0..count).map(|i| (i as f32 * 0.618).sin()).collect();
    Ok(Tensor::from_vec(wave, shape, &Device::Cpu)?)
}

/// Makes a variable of some numbers, which gets a gradient.
pub fn variable(shape: &[usize]) -> Result<Tensor, Failure> {
    Ok(Var::from_tensor(&tensor(shape)?)?.as_tensor().clone())
}
