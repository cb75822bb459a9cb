//! What the test process allocates. The memory of the decoders in assembly and C++ is not counted.
//!
//! A program whose tests ask for it is `tests/alone/main.rs` of its crate. It declares once:
//!
//! ```ignore
//! #[global_allocator]
//! static ALLOCATOR: zk0_testkit::allocations::Watched = zk0_testkit::allocations::Watched;
//! ```
//!
//! The whole process is counted, so every test of such a program begins with `let _alone = allocations::alone();`.
//! [`fuzzing::read_again`](crate::fuzzing::read_again) does so itself.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Remembers the largest single allocation, and the most that was allocated at once.
pub struct Watched;

static LARGEST: AtomicUsize = AtomicUsize::new(0);
static HELD: AtomicUsize = AtomicUsize::new(0);
static MOST: AtomicUsize = AtomicUsize::new(0);

fn taken(size: usize) {
    LARGEST.fetch_max(size, Relaxed);
    MOST.fetch_max(HELD.fetch_add(size, Relaxed) + size, Relaxed);
}

// SAFETY: every call goes to the system's allocator unchanged.
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

/// Waits until no other test of the program runs that calls this. The next one waits until the guard is dropped.
pub fn alone() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    // A test that failed before leaves nothing behind that the next one needs.
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The bytes that are allocated now.
pub fn held() -> usize {
    let held = HELD.load(Relaxed);
    // The harness of the tests holds some. Without the declaration, every limit would be kept.
    assert!(held > 0, "`Watched` is not the allocator of this program");
    held
}

/// Returns the largest single allocation while `run` ran, in bytes. The number is meaningful only if nothing else runs.
pub fn largest<T>(run: impl FnOnce() -> T) -> (T, usize) {
    held();
    LARGEST.store(0, Relaxed);
    let value = run();
    (value, LARGEST.load(Relaxed))
}

/// Returns the most bytes that were allocated at once while `run` ran, beyond those held before. The number is meaningful only if
/// nothing else runs.
pub fn peak<T>(run: impl FnOnce() -> T) -> (T, usize) {
    let before = held();
    MOST.store(before, Relaxed);
    let value = run();
    (value, MOST.load(Relaxed).saturating_sub(before))
}
