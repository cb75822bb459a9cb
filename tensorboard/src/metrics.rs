//! What curves are called. The first four names are those that LeRobot's training script gives Weights & Biases. What LeRobot calls `eval/`
//! comes from rollouts in a simulator (`eval/pc_success`); what zk0 calls so are losses.

/// The batch's loss before a step.
pub const LOSS: &str = "train/loss";
/// The norm of the gradient, before clipping.
pub const GRAD_NORM: &str = "train/grad_norm";
/// The learning rate of a step.
pub const LEARNING_RATE: &str = "train/lr";
/// Seconds that a step took.
pub const STEP_SECONDS: &str = "train/update_s";
/// FedProx's term before a step.
pub const FEDPROX: &str = "train/fedprox_loss";
/// The loss on samples that a run holds out, that a simulated node is measured on, or that a claim is evaluated on.
pub const EVAL_LOSS: &str = "eval/loss";
/// The same by LeRobot 0.4's rule, which counts padding, too.
pub const EVAL_LOSS_PLAIN: &str = "eval/loss_plain";
/// The loss of the round's base weights on the samples that a claim is evaluated on.
pub const EVAL_BASE_LOSS: &str = "eval/base_loss";
/// The round that a step belongs to.
pub const ROUND: &str = "zk0/round";
