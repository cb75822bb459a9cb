//! A policy folder: a SmolVLA policy by LeRobot's `save_pretrained`.
//!
//! ```text
//! config.json                                    dimensions, features (LeRobotConfig)
//! model.safetensors                              the state dict, in F32, F16 or BF16
//! policy_preprocessor.json  + .safetensors       from LeRobot 0.4 on: names of cameras and tokenizer, and normalisation of
//! policy_postprocessor.json + .safetensors       states and actions, with statistics; LeRobot 0.3: in the state dict
//! adapter_config.json       + adapter_model      from PEFT, instead of weights: a LoRA adapter of a base policy
//! vlm_config.json                                not LeRobot's: config.json of a VLM that is unknown by name
//! ```
//!
//! [`PolicyFolder::open`] checks names, shapes and types against the configuration's layout, without reading weights.
//! [`PolicyFolder::write`] makes a folder that LeRobot loads and where only the given weights differ; [`PolicyFolder::write_trained`] adds
//! a recording's statistics. [`Inference`] is how the policy is used.

mod adapter;
mod folder;
mod inference;
mod json_file;
mod lerobot_config;
mod other_folder;
mod other_statistics;
mod processors;
mod statistics;
mod tokenizer_file;
mod vlm_config;
mod write;

pub use folder::{PolicyFolder, CONFIG, VLM_CONFIG, WEIGHTS};
pub use inference::{Inference, Normalisation, STEPS};
pub use lerobot_config::{default_expert_mlp_width, LeRobotConfig, IMAGES};
pub use vlm_config::VlmDims;
pub use write::Precision;
