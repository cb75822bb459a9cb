//! Random changes of the pictures that training sees, as LeRobot makes them (`lerobot/datasets/transforms.py`).
//!
//! - [`config`]: which transforms there are, by LeRobot's names and with its defaults.
//! - [`transform`] is one transform with its parameters. [`color`] and [`affine`] compute it as torchvision does.
//! - [`drawing`] draws transforms and their parameters, from a seed.
//! - [`variants`]: K transformed variants of each training frame. Each has a name in the prefix cache, so that it is computed once.
//!
//! Only the frames of a [`Variants`] are ever transformed. What is evaluated or committed to is named without it.

mod affine;
mod color;
pub mod config;
pub mod drawing;
pub mod picture;
pub mod transform;
pub mod variants;

pub use affine::AffineTransform;
pub use config::ImageTransformsConfig;
pub use picture::Picture;
pub use transform::Transform;
pub use variants::Variants;
