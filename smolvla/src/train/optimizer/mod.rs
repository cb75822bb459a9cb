//! AdamW with gradient clipping, FedProx's proximal term and FedCM's last global step ([`last_step`]); and SGD with SCAFFOLD's correction
//! ([`sgd`]).
//!
//! AdamW agrees with `torch.optim.AdamW` and `torch.nn.utils.clip_grad_norm_`. On the CPU a step is one pass over each tensor ([`host`]),
//! not ten over the published expert's 98 million values. Other devices, and the CPU [without
//! kernels](crate::policy::model::kernels::without), use tensor operations ([`device`]).
//!
//! Sums are in blocks of a fixed size, in order, so the number of threads does not matter.

mod adamw;
mod device;
mod factors;
mod host;
mod last_step;
mod sgd;
mod step;

pub use adamw::{AdamMoment, AdamW};
pub use factors::AdamWOptions;
pub use last_step::{check_alpha, LastStep};
pub use sgd::Sgd;
pub use step::{Optimizer, Stepped};
