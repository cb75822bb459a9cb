//! Freed memory is kept while a model exists. The file has only one test, because the test watches the whole process.

use candle_core::{DType, Device, Tensor};
use libmimalloc_sys::mi_option_get;
use zk0_smolvla::policy::memory::{Allocator, KeepFreed, KEPT_FOR, PURGE_DELAY};

#[global_allocator]
static ALLOCATOR: Allocator = Allocator;

/// Returns how many bytes of this process are in memory.
fn resident() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|l| l.starts_with("VmRSS:")).unwrap();
    line.split_whitespace()
        .nth(1)
        .unwrap()
        .parse::<u64>()
        .unwrap()
        << 10
}

/// Returns the number of milliseconds until freed memory is given back.
fn delay() -> i64 {
    // SAFETY: the call only reads a number.
    unsafe { mi_option_get(PURGE_DELAY) }
}

#[test]
fn freed_memory_is_kept_until_the_last_guard_is_gone() {
    const SIZE: usize = 256 << 20;
    let (usual, before) = (delay(), resident());
    assert!(usual > 0, "{usual}");
    let (outer, inner) = (KeepFreed::new(), KeepFreed::new());
    drop(Tensor::ones(SIZE / 4, DType::F32, &Device::Cpu));
    drop(inner);
    assert_eq!(delay(), KEPT_FOR);
    assert!(resident() > before + SIZE as u64 / 2, "kept");
    drop(outer);
    assert_eq!(delay(), usual);
    assert!(resident() < before + SIZE as u64 / 2, "given back");
}
