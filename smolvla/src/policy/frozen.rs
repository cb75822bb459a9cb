//! Device and precision of a policy's frozen half. Both decide the last digits of keys and values, and are part of a prefix cache's keys.

use candle_core::{DType, Device};
use serde::{Deserialize, Serialize};

use crate::error::{PolicyError, Result};

/// Rounding of the operands of products (linear maps, attention). Sums, norms, softmax, activations and residual streams stay `f32`, as
/// under PyTorch's autocast.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FrozenPrecision {
    /// No rounding.
    #[default]
    F32,
    /// bfloat16, as in LeRobot on a GPU; no faster on the CPU.
    Bf16,
}

impl FrozenPrecision {
    /// `f32` or `bf16`.
    pub fn name(self) -> &'static str {
        match self {
            Self::F32 => "f32",
            Self::Bf16 => "bf16",
        }
    }

    /// The precision of a name.
    ///
    /// # Errors
    /// [`PolicyError::Options`] for any other name.
    pub fn from_name(name: &str) -> Result<Self> {
        match name {
            "f32" => Ok(Self::F32),
            "bf16" => Ok(Self::Bf16),
            _ => Err(PolicyError::Options(format!(
                "no precision of the frozen half is called `{name}`; there are `f32` and `bf16`"
            ))),
        }
    }

    /// The operands' type.
    pub fn operands(self) -> DType {
        match self {
            Self::F32 => DType::F32,
            Self::Bf16 => DType::BF16,
        }
    }
}

/// By default CPU and `f32`, as in dataset commitments.
#[derive(Clone, Debug)]
pub struct FrozenPlace {
    /// The device.
    pub device: Device,
    /// The precision.
    pub precision: FrozenPrecision,
}

impl Default for FrozenPlace {
    fn default() -> Self {
        Self {
            device: Device::Cpu,
            precision: FrozenPrecision::F32,
        }
    }
}

impl FrozenPlace {
    /// On `device`; by default `bf16` on a GPU, `f32` on the CPU.
    pub fn on(device: Device, precision: Option<FrozenPrecision>) -> Self {
        let usual = if device.is_cpu() {
            FrozenPrecision::F32
        } else {
            FrozenPrecision::Bf16
        };
        Self {
            precision: precision.unwrap_or(usual),
            device,
        }
    }

    /// The kind of device and the precision: equal names give equal numbers, nearly so on different GPUs.
    pub fn name(&self) -> String {
        let device = match &self.device {
            Device::Cpu => "cpu",
            Device::Cuda(_) => "cuda",
            Device::Metal(_) => "metal",
        };
        format!("{device}/{}", self.precision.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn precisions_go_by_name_and_places_by_both() {
        for precision in [FrozenPrecision::F32, FrozenPrecision::Bf16] {
            let named = FrozenPrecision::from_name(precision.name()).unwrap();
            assert_eq!(named, precision);
            let place = FrozenPlace::on(Device::Cpu, Some(precision));
            assert_eq!(place.name(), format!("cpu/{}", precision.name()));
        }
        for name in ["", "fp16", "BF16", "float32"] {
            let error = FrozenPrecision::from_name(name).unwrap_err().to_string();
            assert!(error.contains(&format!("called `{name}`")), "{error}");
        }
        assert_eq!(FrozenPlace::on(Device::Cpu, None).name(), "cpu/f32");
        assert_eq!(FrozenPlace::default().name(), "cpu/f32");
    }
}
