//! The names of curves. The first four are LeRobot's for Weights & Biases. LeRobot's `eval/` comes from rollouts in a simulator
//! (`eval/pc_success`); here it holds losses.

/// A batch's loss before a step.
pub const LOSS: &str = "train/loss";
/// The gradient's norm, before clipping.
pub const GRAD_NORM: &str = "train/grad_norm";
/// A step's learning rate.
pub const LEARNING_RATE: &str = "train/lr";
/// A step's seconds.
pub const STEP_SECONDS: &str = "train/update_s";
/// FedProx's term before a step.
pub const FEDPROX: &str = "train/fedprox_loss";
/// The loss on a run's held-out samples, or on a simulated node's or a claim's evaluation samples.
pub const EVAL_LOSS: &str = "eval/loss";
/// The same by LeRobot 0.4's rule, which counts padding.
pub const EVAL_LOSS_PLAIN: &str = "eval/loss_plain";
/// The loss of the round's base weights on a claim's evaluation samples.
pub const EVAL_BASE_LOSS: &str = "eval/base_loss";
/// A step's round.
pub const ROUND: &str = "zk0/round";
