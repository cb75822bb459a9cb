//! The allocator of programs that train, and when it keeps what is freed.
//!
//! A training step frees gigabytes of tensors and asks for as much again. Giving the memory back to the system in between takes as
//! long as a third of the step, because the system has to clear the pages again.

use std::sync::Mutex;

use libmimalloc_sys::{mi_collect, mi_option_get, mi_option_set, mi_option_t};

/// For `#[global_allocator]`.
pub use mimalloc::MiMalloc as Allocator;

/// `mi_option_purge_delay` of mimalloc 3: milliseconds until freed memory is given back. The bindings name stable options alone.
pub const PURGE_DELAY: mi_option_t = 15;

/// A day. With mimalloc's "never" (-1), memory freed meanwhile would not be given back later either.
pub const KEPT_FOR: i64 = 86_400_000;

/// How many of [`KeepFreed`] there are, and the delay before the first.
static KEEPING: Mutex<(usize, i64)> = Mutex::new((0, 0));

/// While one exists, [`Allocator`] keeps freed memory for later use. With the last, it is given back.
#[derive(Debug)]
pub struct KeepFreed(());

impl KeepFreed {
    /// From now on. Does nothing in a program with another allocator.
    #[must_use = "memory is given back once this is dropped"]
    #[allow(clippy::new_without_default)]
    pub fn new() -> Self {
        let mut keeping = KEEPING.lock().unwrap_or_else(|e| e.into_inner());
        if keeping.0 == 0 {
            // SAFETY: this reads and writes a number. Options may be set at any time.
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
            // SAFETY: as above. Collecting frees nothing that is in use.
            unsafe {
                mi_option_set(PURGE_DELAY, keeping.1);
                mi_collect(true);
            }
        }
    }
}
