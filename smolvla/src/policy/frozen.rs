//! Where the frozen half of a policy is computed, and in which precision.
//!
//! Both decide the last digits of a frame's keys and values, and so what a prefix cache holds. They are part of its keys.

use candle_core::{DType, Device};
use serde::{Deserialize, Serialize};

use crate::error::{PolicyError, Result};

/// What the operands of the frozen half's products are rounded to: those of its linear maps, and of its attention. Sums, norms,
/// softmax, activations and what layers add to are `f32` always, as under PyTorch's autocast.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FrozenPrecision {
    /// Not at all.
    #[default]
    F32,
    /// bfloat16, as LeRobot computes the frozen half on a GPU. On the CPU the same rounding makes nothing faster.
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

    /// The type of the operands.
    pub fn operands(self) -> DType {
        match self {
            Self::F32 => DType::F32,
            Self::Bf16 => DType::BF16,
        }
    }
}

/// Where and how exactly the frozen half is computed. By default on the CPU in `f32`: what a dataset commitment is about.
#[derive(Clone, Debug)]
pub struct FrozenPlace {
    /// Where.
    pub device: Device,
    /// How exactly.
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
    /// On `device`, in the precision asked for, or else `bf16` on a GPU and `f32` on the CPU.
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

    /// Names the kind of device and the precision: two places of one name give the same numbers, or nearly so on GPUs of
    /// different make.
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
