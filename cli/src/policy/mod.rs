//! What commands that train and evaluate share.

mod cache_options;
pub mod calibration;
mod device_options;
pub mod network_folder;
mod recording_fit;
mod source;
mod transform_options;
pub mod whole_folder;

pub use cache_options::{cache_failed, CacheOptions};
pub use device_options::DeviceOptions;
pub use recording_fit::refuse_unfit;
pub use source::{one, read, PolicySource};
pub use transform_options::{TransformOptions, Transforms};
