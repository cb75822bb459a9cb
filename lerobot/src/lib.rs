//! Robot recordings and policies as [LeRobot](https://github.com/huggingface/lerobot) writes them.
//!
//! The crate reads what LeRobot leaves on disk and on the Hugging Face Hub, and needs neither Python nor a tensor library:
//!
//! - [`dataset`] opens a LeRobotDataset folder (v2.0, v2.1 or v3.0) and checks it. It gives the frames with their pictures, states
//!   and actions, and the statistics to normalise them with.
//! - [`hub`] fetches a recording from the Hugging Face Hub, pinned to a commit.
//! - [`policy_folder`] reads and writes the folder of a SmolVLA policy, as `save_pretrained` leaves it: its configuration, its
//!   weights, and its normalisation.
//! - [`config`] has every dimension of a SmolVLA policy. [`layout`] has the names and shapes of the tensors that follow from them.
//! - [`tokenizer`] reads a `tokenizer.json` and uses it as LeRobot does.
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
