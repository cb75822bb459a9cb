//! Local training: fits the expert to samples.
//!
//! - [`options`]: how to train, by default LeRobot's preset. [`schedule`]: learning rates.
//! - [`order`]: samples and noise, from the seed and the step's number. So variables, moments and that number describe a run fully.
//! - [`learner`]: the trainable variables and a batch's loss.
//! - [`optimizer`]: AdamW with FedProx and FedCM, and SGD for SCAFFOLD.
//! - [`scaffold`]: SCAFFOLD's control variates.
//! - [`trainer`]: makes steps. [`train_on`] makes all of them.
//! - [`snapshots`]: a run on disk. A stopped run resumes from the newest and ends with the same bytes.
//! - [`measured_loss`], [`adaptive`]: rates that follow losses.
//! - [`split`]: holds out episodes for evaluation.
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
