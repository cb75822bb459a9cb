//! CPU kernels of the operations that training spends its time in, as candle custom operations with a backward pass.
//!
//! candle's own operations run elementwise work in one thread, make a pass over memory for each of them, and compute a
//! gradient for every operand of a product, frozen weights included. These do neither:
//!
//! - [`linear`]: `x·wᵀ + b`; no gradient is computed for weights that are frozen.
//! - [`softmax`]: scale, mask and softmax of attention scores in one pass.
//! - [`attention`]: attention without a mask and without a gradient, block by block: the frozen vision tower's.
//! - [`gelu`]: the frozen vision tower's activation.
//! - [`swiglu`], [`norm`], [`rotate`]: the decoder layers' elementwise work, forward and backward in a pass each.
//!
//! On another device than the CPU each falls back to candle's operations. [`matrix`] is the product all are made of, and
//! [`vector`] has the exponential function that compilers can vectorise.
//!
//! Work is divided among threads so that no sum depends on their number: results repeat bit for bit on one machine.

pub mod attention;
pub mod gelu;
pub mod linear;
pub mod matrix;
pub mod norm;
pub mod rotate;
pub mod softmax;
pub mod swiglu;
pub mod vector;

use candle_core::{CpuStorage, Layout, Result, Tensor};

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
