//! Local training: the expert, fitted to samples.
//!
//! - [`options`]: how to train, LeRobot's preset by default. [`schedule`] gives the learning rate of each step.
//! - [`order`]: which samples a step takes, and with what noise. Both are functions of the seed and the step's number alone, so a
//!   run is at every step fully described by its variables, its moments and that number.
//! - [`learner`]: the trainable variables and the loss of a batch, for either [`TrainScope`].
//! - [`optimizer`] is AdamW, with what FedProx and FedCM add to its steps; and SGD, for SCAFFOLD.
//! - [`scaffold`]: the control variates of SCAFFOLD, which follow from the rounds before.
//! - [`trainer`]: makes steps. [`train_on`] makes all of them.
//! - [`snapshots`]: a run on disk. A run that is stopped at any moment resumes from its newest snapshot and ends with the same bytes.
//! - [`measured_loss`]: the loss that learning rates follow. [`adaptive`] has the rules by which a federation's losses change its
//!   rates.
//! - [`split`]: episodes held out for evaluation.
//!
//! The same start, samples and options give the same bits on the same CPU.

pub mod adaptive;
pub mod learner;
pub mod measured_loss;
pub mod optimizer;
pub mod options;
pub mod order;
mod run;
pub mod scaffold;
pub mod schedule;
pub mod snapshots;
pub mod split;
pub mod trainer;

pub use learner::TrainingSamples;
pub use options::{TrainOptions, TrainScope};
pub use run::{train, train_by_sgd, train_on, TrainingResult};
pub use trainer::{FedCm, Trainer, TrainingStep};
