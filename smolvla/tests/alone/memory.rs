//! Freed memory is kept while a model exists. The test asks zk0's allocator itself, because this program has another one.

use std::alloc::{GlobalAlloc, Layout};

use libmimalloc_sys::mi_option_get;
use zk0_smolvla::policy::memory::{Allocator, KeepFreed, KEPT_FOR, PURGE_DELAY};
use zk0_testkit::allocations::alone;

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

/// Allocates a tensor's memory, fills it and frees it, as a program with zk0's allocator does.
fn fill_and_free(size: usize) {
    let layout = Layout::array::<f32>(size / 4).unwrap();
    // SAFETY: the memory has this layout, and is freed once.
    unsafe {
        let memory = Allocator.alloc(layout);
        assert!(!memory.is_null());
        memory.write_bytes(1, layout.size());
        Allocator.dealloc(memory, layout);
    }
}

#[test]
fn freed_memory_is_kept_until_the_last_guard_is_gone() {
    const SIZE: usize = 256 << 20;
    let _alone = alone();
    let (usual, before) = (delay(), resident());
    assert!(usual > 0, "{usual}");
    let (outer, inner) = (KeepFreed::new(), KeepFreed::new());
    fill_and_free(SIZE);
    drop(inner);
    assert_eq!(delay(), KEPT_FOR);
    assert!(resident() > before + SIZE as u64 / 2, "kept");
    drop(outer);
    assert_eq!(delay(), usual);
    assert!(resident() < before + SIZE as u64 / 2, "given back");
}
