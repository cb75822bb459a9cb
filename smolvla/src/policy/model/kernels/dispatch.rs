//! Which tensors the kernels serve, and on which threads.

use std::cell::Cell;

use candle_core::{DType, Result, Tensor};
use rayon::prelude::*;

thread_local! {
    /// Whether [`without`] runs in this thread.
    static SET_ASIDE: Cell<bool> = const { Cell::new(false) };
}

/// `f32`, CPU, outside [`without`].
pub(crate) fn serve(x: &Tensor) -> bool {
    x.device().is_cpu() && x.dtype() == DType::F32 && !SET_ASIDE.get()
}

/// Runs `work` in this thread by the operations of other devices.
pub fn without<R>(work: impl FnOnce() -> R) -> R {
    /// Restores the value, also after a panic.
    struct Before(bool);
    impl Drop for Before {
        fn drop(&mut self) {
            SET_ASIDE.set(self.0);
        }
    }
    let _before = Before(SET_ASIDE.replace(true));
    work()
}

/// For sums, norms and functions.
pub(super) fn widened(x: &Tensor) -> Result<Tensor> {
    match x.dtype() {
        DType::BF16 | DType::F16 => x.to_dtype(DType::F32),
        _ => Ok(x.clone()),
    }
}

/// Fewer operations are faster in one thread.
const SMALL: usize = 1 << 20;

/// Runs `work` on numbered chunks of `out`, `size` values each but the last; in parallel if that pays for this many `operations` a value.
pub(super) fn in_chunks(
    out: &mut [f32],
    size: usize,
    operations: usize,
    work: impl Fn(usize, &mut [f32]) + Sync,
) {
    let size = size.max(1);
    if out.len().saturating_mul(operations) < SMALL {
        let chunks = out.chunks_mut(size).enumerate();
        chunks.for_each(|(at, chunk)| work(at, chunk));
    } else {
        let chunks = out.par_chunks_mut(size).enumerate();
        chunks.for_each(|(at, chunk)| work(at, chunk));
    }
}

/// [`in_chunks`] for functions with one exponential per value; `work` gets its block's start.
pub(super) fn in_blocks(out: &mut [f32], work: impl Fn(usize, &mut [f32]) + Sync) {
    const BLOCK: usize = 1 << 14;
    in_chunks(out, BLOCK, 16, |at, block| work(at * BLOCK, block));
}

#[cfg(test)]
mod tests {
    use super::*;
    use candle_core::Device;

    #[test]
    fn kernels_are_set_aside_in_one_thread_and_come_back() {
        let x = Tensor::zeros(1, DType::F32, &Device::Cpu).unwrap();
        assert!(serve(&x));
        without(|| {
            assert!(!serve(&x));
            without(|| assert!(!serve(&x)));
            assert!(!serve(&x));
            std::thread::scope(|scope| scope.spawn(|| assert!(serve(&x))).join().unwrap());
        });
        let panicked = std::panic::catch_unwind(|| without(|| panic!("on purpose")));
        assert!(panicked.is_err() && serve(&x));
    }
}
