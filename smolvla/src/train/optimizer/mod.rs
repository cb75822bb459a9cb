//! AdamW with gradient clipping, the proximal term of FedProx, and the last global step of FedCM ([`last_step`]); and SGD with the correction
//! of SCAFFOLD ([`sgd`]).
//!
//! Steps of AdamW agree with `torch.optim.AdamW` and `torch.nn.utils.clip_grad_norm_`. On the CPU a step is one pass over each tensor
//! ([`host`]): ten tensor operations in a row would read and write the 98 million values of the published expert ten times.
//! On other devices, and [without the kernels](crate::policy::model::kernels::without), it is made of tensor operations ([`device`]).
//!
//! The result does not depend on the number of threads: sums are taken in blocks of a fixed size, in order.

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
