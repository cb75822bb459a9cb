//! A policy folder: a SmolVLA policy as LeRobot's `save_pretrained` leaves it. It holds
//!
//! ```text
//! config.json                                    dimensions, features (LeRobotConfig)
//! model.safetensors                              the state dict; F32, F16 and BF16 are read
//! policy_preprocessor.json  + .safetensors       from LeRobot 0.4 on: names of cameras, the tokenizer's name, and normalisation of
//! policy_postprocessor.json + .safetensors       states and actions, with its statistics. LeRobot 0.3 kept these in the state dict.
//! adapter_config.json       + adapter_model      instead of the weights, from PEFT: a LoRA adapter of another policy, its base
//! vlm_config.json                                not LeRobot's: the VLM's config.json, where its name is not a known one
//! ```
//!
//! [`PolicyFolder::open`] checks names, shapes and types against the layout that follows from the configuration, without reading
//! a single weight. [`PolicyFolder::write`] leaves a folder that LeRobot loads, in which only the given weights differ.
//! [`PolicyFolder::write_trained`] also puts a recording's statistics into it. [`Inference`] says how the policy is used.

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
