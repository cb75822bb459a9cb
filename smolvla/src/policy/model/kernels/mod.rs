//! CPU kernels for training's costly operations: candle custom operations with a backward pass.
//!
//! candle runs elementwise work in one thread, with a pass over memory each, and computes gradients even for frozen operands. These do not:
//!
//! - [`linear`]: `x·wᵀ + b`, without gradients for frozen weights.
//! - [`softmax`]: scale, mask and softmax in one pass.
//! - [`heads`]: attention's products, for heads that share keys.
//! - [`attention`], [`gelu`]: the frozen vision tower's.
//! - [`gradients`]: a loss's gradients, stored directly.
//! - [`swiglu`], [`norm`], [`rotate`]: the decoder layers' elementwise work, one pass each way.
//!
//! Small work stays in one thread: waking another takes longer.
//!
//! [`matrix`] is the product behind them, and [`vector`] has a vectorisable exponential.
//!
//! On other devices, and for numbers other than `f32`, functions use candle's operations and gradients, and [`matmul`]. [`without`] does so
//! on the CPU, for comparison.
//!
//! No sum depends on the number of threads: results repeat bit for bit on a machine.

pub mod attention;
mod dispatch;
pub mod gelu;
pub mod gradients;
pub mod heads;
pub mod linear;
pub mod matmul;
pub mod matrix;
pub mod norm;
mod operation;
pub mod rotate;
pub mod softmax;
pub mod swiglu;
pub mod vector;

pub(crate) use dispatch::serve;
pub use dispatch::without;
