//! SmolVLA in candle, in the two phases of training and proving.
//!
//! - [`prefix`]: images, language and state through the [`vision`] tower and language layers to the per-layer key/value cache. Frozen in
//!   training: one run per frame.
//! - [`expert`]: noisy actions and a time to the velocity.
//! - [`flow`]: the flow-matching loss; [`sampling`] follows the velocity from noise to actions.
//! - [`state_token`]: the one prefix token that training may change.
//! - [`visibility`]: which token sees which, and positions.
//! - [`observe`]: watches values in the expert.
//! - [`kernels`]: costly operations, fast on the CPU.
//!
//! All but the vision tower has a backward pass. (candle's fused softmax, norm, attention and rotary operations silently drop gradients;
//! the kernels here have them or fail.)

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
