//! The tests of the policy and of training.

mod actor;
mod devices;
mod fedcm;
mod frames;
mod image_transforms;
mod measure;
mod parity;
mod policy;
mod published_policy_folder;
mod published_size;
mod reference;
mod scaffold;
mod training;
