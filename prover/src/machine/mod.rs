//! What this machine can prove with, checked before work that takes minutes.

mod control_group;
mod device;
mod device_error;
#[cfg(feature = "cuda")]
mod gpu;
pub mod leftovers;
mod lock;
mod options;
mod room;

pub use device::{Device, DeviceKind, UnknownDevice};
pub use device_error::DeviceError;
#[cfg(feature = "cuda")]
pub use gpu::Gpu;
pub use lock::{LockError, ProverLock};
pub use options::{peak_memory, OptionsError, ProverOptions, Resources};
pub use room::{check_disk, check_memory, free_disk, NoRoom};
