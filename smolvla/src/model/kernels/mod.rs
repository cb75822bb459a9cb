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
//! On another device than the CPU each falls back to candle's operations. [`matrix`] is the product all are made of, and
//! [`vector`] has the exponential function that compilers can vectorise.
//!
//! Work is divided among threads so that no sum depends on their number: results repeat bit for bit on one machine.

pub mod attention;
pub mod gelu;
pub mod gradients;
pub mod heads;
pub mod linear;
pub mod matrix;
pub mod norm;
pub mod rotate;
pub mod softmax;
pub mod swiglu;
pub mod vector;

use candle_core::{CpuStorage, Layout, Result, Tensor};
use rayon::prelude::*;

/// Whether these kernels serve a tensor: `f32` on the CPU.
pub(crate) fn serve(x: &Tensor) -> bool {
    x.device().is_cpu() && x.dtype() == candle_core::DType::F32
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
