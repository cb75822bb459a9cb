//! Robot recordings and policies as [LeRobot](https://github.com/huggingface/lerobot) writes them, on disk or on the Hugging Face Hub,
//! without Python or a tensor library.
//!
//! ```
//! use zk0_lerobot::dataset::Dataset;
//!
//! let recording = Dataset::open("../tests/fixtures/datasets/so100_pickplace")?;
//! let mut loader = recording.loader(50)?;
//! for index in 0..2 {
//!     let frame = loader.frame(index)?;
//!     assert_eq!(frame.images.len(), recording.cameras().len());
//!     assert_eq!(frame.actions.len(), 50 * frame.state.len());
//! }
//! # Ok::<(), zk0_lerobot::dataset::DatasetError>(())
//! ```
//!
//! - [`dataset`] opens and checks a LeRobotDataset folder (v2.0, v2.1 or v3.0): frames with pictures, states and actions, and statistics.
//! - [`hub`] fetches a recording from the Hugging Face Hub, pinned to a commit.
//! - [`policy_folder`] reads and writes a SmolVLA policy as `save_pretrained` does: configuration, weights, normalisation.
//! - [`config`] has every dimension of a SmolVLA policy, [`layout`] the names and shapes of its tensors.
//! - [`tokenizer`] uses a `tokenizer.json` as LeRobot does.
//! - [`StoredTensors`] is a safetensors file on disk.

pub mod config;
pub mod dataset;
pub mod error;
pub mod hub;
pub mod layout;
mod lfs_pointer;
mod limits;
pub mod policy_folder;
mod stored_tensors;
pub mod tokenizer;

pub use config::PolicyConfig;
pub use error::StoredPolicyError;
pub use stored_tensors::StoredTensors;
