//! The allocator of training programs. A training step frees and needs gigabytes. Returning them in between takes up to a third of the
//! step, because the system clears pages again.

use std::sync::Mutex;

use libmimalloc_sys::{mi_collect, mi_option_get, mi_option_set, mi_option_t};

/// For `#[global_allocator]`.
pub use mimalloc::MiMalloc as Allocator;

/// mimalloc 3's `mi_option_purge_delay`, in milliseconds. The bindings name only stable options.
pub const PURGE_DELAY: mi_option_t = 15;

/// A day. mimalloc's "never" (-1) would keep memory forever.
pub const KEPT_FOR: i64 = 86_400_000;

/// The number of [`KeepFreed`], and the delay before the first.
static KEEPING: Mutex<(usize, i64)> = Mutex::new((0, 0));

/// While one exists, [`Allocator`] keeps freed memory.
#[derive(Debug)]
pub struct KeepFreed(());

impl KeepFreed {
    /// Keeps freed memory from now on.
    #[must_use = "memory is given back once this is dropped"]
    #[allow(clippy::new_without_default)]
    pub fn new() -> Self {
        let mut keeping = KEEPING.lock().unwrap_or_else(|e| e.into_inner());
        if keeping.0 == 0 {
            // SAFETY: reads and writes a number; options may be set at any time.
            unsafe {
                keeping.1 = mi_option_get(PURGE_DELAY);
                mi_option_set(PURGE_DELAY, KEPT_FOR);
            }
        }
        keeping.0 += 1;
        Self(())
    }
}

impl Drop for KeepFreed {
    fn drop(&mut self) {
        let mut keeping = KEEPING.lock().unwrap_or_else(|e| e.into_inner());
        keeping.0 -= 1;
        if keeping.0 == 0 {
            // SAFETY: as above. Collecting frees nothing in use.
            unsafe {
                mi_option_set(PURGE_DELAY, keeping.1);
                mi_collect(true);
            }
        }
    }
}
