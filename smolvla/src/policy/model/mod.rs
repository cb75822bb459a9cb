//! SmolVLA in candle, in the two phases that training and proving need.
//!
//! - [`prefix`]: images, language and state through the [`vision`] tower and the language layers, giving the
//!   per-layer key/value cache. Frozen in training: one run per frame, ever.
//! - [`expert`]: noisy actions and a time, through the expert's layers over that cache, giving the velocity.
//! - [`flow`]: the flow-matching loss between them; [`sampling`] follows the velocity from noise to actions.
//! - [`state_token`]: the one token of the prefix that training may change.
//! - [`visibility`]: which token sees which, and the positions of all.
//! - [`observe`]: watches the values inside a pass of the expert.
//!
//! - [`kernels`]: what their time is spent in, fast on the CPU.
//!
//! Everything but the vision tower is made of operations with a backward pass. (candle's fused softmax, norm,
//! attention and rotary operations have none and drop gradients silently; the kernels here have one, or say so.)

pub mod attention;
pub mod expert;
pub mod flow;
pub mod kernels;
pub mod key_values;
pub mod layers;
pub mod observe;
pub mod parameters;
pub mod prefix;
pub mod rope;
pub mod sampling;
pub mod state_token;
pub mod time_embedding;
pub mod visibility;
pub mod vision;

pub use parameters::PolicyParameters;
