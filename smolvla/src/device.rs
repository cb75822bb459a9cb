//! Where tensors live.

use candle_core::Device;

use crate::error::{PolicyError, Result};

/// The device of a name: `cpu`, `cuda` (the first GPU) or `cuda:N`.
///
/// # Errors
/// [`PolicyError::Options`] for another name, or where this build or machine cannot use that device.
pub fn device(name: &str) -> Result<Device> {
    let unknown = || {
        PolicyError::Options(format!(
            "no device is called `{name}`; there are `cpu`, `cuda` and `cuda:N`"
        ))
    };
    let number = match name.split_once(':') {
        None if name == "cpu" => return Ok(Device::Cpu),
        None if name == "cuda" => 0,
        Some(("cuda", number)) => number.parse().map_err(|_| unknown())?,
        _ => return Err(unknown()),
    };
    if !candle_core::utils::cuda_is_available() {
        return Err(PolicyError::Options(format!(
            "device `{name}`: this build of zk0 trains on the CPU alone"
        )));
    }
    Device::new_cuda(number)
        .map_err(|error| PolicyError::Options(format!("device `{name}` cannot be used: {error}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn devices_go_by_name() {
        assert!(device("cpu").unwrap().is_cpu());
        for name in ["", "gpu", "cuda:", "cuda:x", "cpu:0", "CPU"] {
            let error = device(name).unwrap_err().to_string();
            assert!(error.contains("no device is called"), "{error}");
        }
    }
}
