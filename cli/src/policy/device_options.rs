//! The options for the device of `zk0 train` and `zk0 eval`.

use anyhow::Result;
use zk0_smolvla::policy::device::device;
use zk0_smolvla::policy::frozen::{FrozenPlace, FrozenPrecision};

/// A device, and how exactly the frozen half is computed on it.
#[derive(Clone, Debug, clap::Args)]
pub struct DeviceOptions {
    /// Compute on this device: cpu, cuda or cuda:N.
    #[arg(long, default_value = "cpu")]
    pub device: String,
    /// Round the factors in the frozen half to this type: bf16, or f32 for no rounding [default: bf16 on a GPU, f32 on the CPU]
    #[arg(long, value_name = "PRECISION", value_parser = FrozenPrecision::from_name)]
    frozen_precision: Option<FrozenPrecision>,
}

impl DeviceOptions {
    /// Opens the device.
    ///
    /// # Errors
    /// No device has that name, or this build or machine cannot use it.
    pub fn open(&self) -> Result<FrozenPlace> {
        let device = device(&self.device)?;
        Ok(FrozenPlace::on(device, self.frozen_precision))
    }
}
