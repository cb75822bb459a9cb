//! Random changes of training pictures, as in LeRobot (`lerobot/datasets/transforms.py`).
//!
//! - [`config`]: LeRobot's names and defaults.
//! - [`transform`]: one transform. [`color`] and [`affine`] compute it as torchvision does.
//! - [`drawing`]: draws transforms and parameters from a seed.
//! - [`variants`]: K transformed variants of each training frame.
//!
//! Only frames from a [`Variants`] are transformed, never evaluated or committed ones.

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
