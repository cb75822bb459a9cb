//! CPU kernels of the operations that training spends its time in, as candle custom operations with a backward pass.
//!
//! candle's own operations run elementwise work in one thread, make a pass over memory for each of them, and compute a
//! gradient for every operand of a product, frozen weights included. These do neither:
//!
//! - [`linear`]: `x·wᵀ + b`; no gradient is computed for weights that are frozen.
//! - [`softmax`]: scale, mask and softmax of attention scores in one pass.
//! - [`heads`]: queries by keys and weights by values, for heads that share keys.
//! - [`attention`]: attention without a mask and without a gradient, block by block: the frozen vision tower's.
//! - [`gradients`]: the gradients of a loss, written to where they belong.
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
