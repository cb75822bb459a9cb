//! Where tensors live.

use std::panic::{self, UnwindSafe};

pub use candle_core::Device;

use crate::error::{PolicyError, Result};

/// The device of a name: `cpu`, `cuda` (the first GPU) or `cuda:N`.
///
/// # Errors
/// [`PolicyError::Options`] for another name, or a device that this build or machine cannot use.
pub fn device(name: &str) -> Result<Device> {
    let Some(number) = gpu(name)? else {
        return Ok(Device::Cpu);
    };
    if !candle_core::utils::cuda_is_available() {
        return Err(PolicyError::Options(format!(
            "device `{name}`: this build of zk0 trains on the CPU alone; `make cuda` makes one for NVIDIA GPUs"
        )));
    }
    // cudarc panics if a CUDA library is missing.
    let opened = quietly(|| Device::new_cuda(number).map_err(|error| error.to_string()));
    opened
        .and_then(|opened| opened)
        .map_err(|cause| PolicyError::Options(format!("device `{name}` cannot be used: {cause}")))
}

/// Checks a device's name, not that it can be used.
///
/// # Errors
/// [`PolicyError::Options`] lists the names.
pub fn check_name(name: &str) -> Result<()> {
    gpu(name).map(drop)
}

/// `None` for the CPU.
fn gpu(name: &str) -> Result<Option<usize>> {
    let unknown = || {
        PolicyError::Options(format!(
            "no device is called `{name}`; there are `cpu`, `cuda` and `cuda:N`"
        ))
    };
    match name.split_once(':') {
        None if name == "cpu" => Ok(None),
        None if name == "cuda" => Ok(Some(0)),
        Some(("cuda", number)) => number.parse().map(Some).map_err(|_| unknown()),
        _ => Err(unknown()),
    }
}

/// The result of `work`, or its panic's message, unprinted.
fn quietly<T>(work: impl FnOnce() -> T + UnwindSafe) -> std::result::Result<T, String> {
    let hook = panic::take_hook();
    panic::set_hook(Box::new(|_| ()));
    let done = panic::catch_unwind(work);
    panic::set_hook(hook);
    done.map_err(|panicked| {
        let text = panicked.downcast_ref::<String>().map(String::as_str);
        let text = text.or_else(|| panicked.downcast_ref::<&str>().copied());
        let text = text.unwrap_or("it panicked");
        // cudarc's message goes on with thirty names.
        match text.split_once(" - searched") {
            Some((missing, _)) => format!(
                "{missing}; it wants NVIDIA's driver, and cuBLAS and cuRAND in LD_LIBRARY_PATH"
            ),
            None => text.to_owned(),
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn devices_go_by_name() {
        assert!(device("cpu").unwrap().is_cpu());
        assert!(check_name("cuda:1").is_ok());
        for name in ["", "gpu", "cuda:", "cuda:x", "cpu:0", "CPU"] {
            let error = device(name).unwrap_err().to_string();
            assert!(error.contains("no device is called"), "{error}");
            assert!(check_name(name).is_err(), "{name}");
        }
    }

    #[test]
    fn a_gpu_that_is_not_there_is_an_error() {
        let error = device("cuda:987").unwrap_err().to_string();
        assert!(error.contains("device `cuda:987`"), "{error}");
    }

    #[test]
    fn panics_become_what_they_said() {
        assert_eq!(quietly(|| 7), Ok(7));
        let cuda = "cuda";
        let reported = quietly(|| -> () { panic!("no lib{cuda}.so") }).unwrap_err();
        assert_eq!(reported, "no libcuda.so");
        let reported = quietly(|| -> () { panic!("no cublas - searched for a, b") }).unwrap_err();
        assert!(
            reported.starts_with("no cublas; it wants NVIDIA's driver"),
            "{reported}"
        );
        assert_eq!(
            quietly(|| -> () { panic!("no GPU") }).unwrap_err(),
            "no GPU"
        );
    }
}
