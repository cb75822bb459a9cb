//! CPU kernels of the operations that training spends its time in, as candle custom operations with a backward pass.
//!
//! candle's own operations run elementwise work in one thread, make a pass over memory for each of them, and compute a
//! gradient for every operand of a product, frozen weights included. These do neither:
//!
//! - [`linear`]: `x·wᵀ + b`; no gradient is computed for weights that are frozen.
//! - [`softmax`]: scale, mask and softmax of attention scores in one pass.
//! - [`heads`]: queries by keys and weights by values, for heads that share keys.
//! - [`attention`]: attention without a mask and without a gradient, block by block: the frozen vision tower's.
//! - [`gradients`]: of a loss, without a detour for weights.
//! - [`gelu`]: the frozen vision tower's activation.
//! - [`swiglu`], [`norm`], [`rotate`]: the decoder layers' elementwise work, forward and backward in a pass each.
//!
//! Small work is done by one thread, as waking another takes longer: a policy of small dimensions is all small work.
//!
//! [`matrix`] is the product all are made of, and [`vector`] has the exponential function that compilers can vectorise.
//!
//! On another device than the CPU, and for other numbers than `f32`, each function does the same by candle's operations, with
//! gradients by candle's rules; products go through [`matmul`]. [`without`] takes that way on the CPU, so that the kernels can be
//! compared with it, and so that what a GPU computes is known here.
//!
//! Work is divided among threads so that no sum depends on their number: results repeat bit for bit on one machine.

pub mod attention;
pub mod gelu;
pub mod gradients;
pub mod heads;
pub mod linear;
pub mod matmul;
pub mod matrix;
pub mod norm;
pub mod rotate;
pub mod softmax;
pub mod swiglu;
pub mod vector;

use std::cell::Cell;

use candle_core::{CpuStorage, DType, Layout, Result, Tensor};
use rayon::prelude::*;

thread_local! {
    /// Whether [`without`] runs in this thread.
    static SET_ASIDE: Cell<bool> = const { Cell::new(false) };
}

/// Whether these kernels serve a tensor: `f32` on the CPU, outside of [`without`].
pub(crate) fn serve(x: &Tensor) -> bool {
    x.device().is_cpu() && x.dtype() == DType::F32 && !SET_ASIDE.get()
}

/// Runs `work` in this thread without these kernels, by the operations that every other device computes with.
pub fn without<R>(work: impl FnOnce() -> R) -> R {
    /// Puts back what was, also when `work` panics.
    struct Before(bool);
    impl Drop for Before {
        fn drop(&mut self) {
            SET_ASIDE.set(self.0);
        }
    }
    let _before = Before(SET_ASIDE.replace(true));
    work()
}

/// What sums, norms and functions are computed in: `f32` in place of shorter numbers.
fn widened(x: &Tensor) -> Result<Tensor> {
    match x.dtype() {
        DType::BF16 | DType::F16 => x.to_dtype(DType::F32),
        _ => Ok(x.clone()),
    }
}

/// The values of a contiguous `f32` tensor on the CPU.
fn values<'a>(storage: &'a CpuStorage, layout: &Layout) -> Result<&'a [f32]> {
    let values = storage.as_slice::<f32>()?;
    match layout.contiguous_offsets() {
        Some((from, to)) => Ok(&values[from..to]),
        None => candle_core::bail!("a kernel needs a contiguous tensor, not {layout:?}"),
    }
}

/// Operations that one thread finishes before another would have begun.
const SMALL: usize = 1 << 20;

/// Runs `work` on the numbered chunks of `out`, `size` values each but the last, in parallel where that is worth it: a value takes
/// about so many operations.
fn in_chunks(
    out: &mut [f32],
    size: usize,
    operations: usize,
    work: impl Fn(usize, &mut [f32]) + Sync,
) {
    let size = size.max(1);
    if out.len().saturating_mul(operations) < SMALL {
        let chunks = out.chunks_mut(size).enumerate();
        chunks.for_each(|(at, chunk)| work(at, chunk));
    } else {
        let chunks = out.par_chunks_mut(size).enumerate();
        chunks.for_each(|(at, chunk)| work(at, chunk));
    }
}

/// [`in_chunks`] for functions of single values that take an exponential each: `work` gets where its block begins.
fn in_blocks(out: &mut [f32], work: impl Fn(usize, &mut [f32]) + Sync) {
    const BLOCK: usize = 1 << 14;
    in_chunks(out, BLOCK, 16, |at, block| work(at * BLOCK, block));
}

#[cfg(test)]
mod tests {
    use super::*;
    use candle_core::Device;

    #[test]
    fn kernels_are_set_aside_in_one_thread_and_come_back() {
        let x = Tensor::zeros(1, DType::F32, &Device::Cpu).unwrap();
        assert!(serve(&x));
        without(|| {
            assert!(!serve(&x));
            without(|| assert!(!serve(&x)));
            assert!(!serve(&x));
            std::thread::scope(|scope| scope.spawn(|| assert!(serve(&x))).join().unwrap());
        });
        let panicked = std::panic::catch_unwind(|| without(|| panic!("on purpose")));
        assert!(panicked.is_err() && serve(&x));
    }
}
