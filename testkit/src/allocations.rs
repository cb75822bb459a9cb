//! What the test process allocates, without decoders in assembly and C++.
//!
//! A crate's `tests/alone/main.rs` declares once:
//!
//! ```ignore
//! #[global_allocator]
//! static ALLOCATOR: zk0_testkit::allocations::Watched = zk0_testkit::allocations::Watched;
//! ```
//!
//! It counts the whole process, so each test begins with `let _alone = allocations::alone();`, or does so by
//! [`fuzzing::read_again`](crate::fuzzing::read_again).

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Counts the largest allocation, and all at once.
pub struct Watched;

static LARGEST: AtomicUsize = AtomicUsize::new(0);
static HELD: AtomicUsize = AtomicUsize::new(0);
static MOST: AtomicUsize = AtomicUsize::new(0);

fn taken(size: usize) {
    LARGEST.fetch_max(size, Relaxed);
    MOST.fetch_max(HELD.fetch_add(size, Relaxed) + size, Relaxed);
}

// SAFETY: every call goes unchanged to the system's allocator.
unsafe impl GlobalAlloc for Watched {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        taken(layout.size());
        unsafe { System.alloc(layout) }
    }
    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        taken(layout.size());
        unsafe { System.alloc_zeroed(layout) }
    }
    unsafe fn realloc(&self, ptr: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        taken(size);
        HELD.fetch_sub(layout.size(), Relaxed);
        unsafe { System.realloc(ptr, layout, size) }
    }
    unsafe fn dealloc(&self, ptr: *mut u8, layout: Layout) {
        HELD.fetch_sub(layout.size(), Relaxed);
        unsafe { System.dealloc(ptr, layout) }
    }
}

/// Waits for a turn, which ends with the guard.
pub fn alone() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    // A failed test leaves nothing that matters.
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Bytes allocated now.
pub fn held() -> usize {
    let held = HELD.load(Relaxed);
    // The harness holds some. Without the declaration, every limit would hold.
    assert!(held > 0, "`Watched` is not the allocator of this program");
    held
}

/// Largest single allocation during `run`, in bytes. Needs [`alone`].
pub fn largest<T>(run: impl FnOnce() -> T) -> (T, usize) {
    held();
    LARGEST.store(0, Relaxed);
    let value = run();
    (value, LARGEST.load(Relaxed))
}

/// Most additional bytes at once during `run`. Needs [`alone`].
pub fn peak<T>(run: impl FnOnce() -> T) -> (T, usize) {
    let before = held();
    MOST.store(before, Relaxed);
    let value = run();
    (value, MOST.load(Relaxed).saturating_sub(before))
}
