//! SP1 behind one interface, on the CPU or on a GPU.

mod cpu;
#[cfg(feature = "cuda")]
mod cuda;
mod interface;
mod start;

pub(crate) use interface::Engine;
pub(crate) use start::start;
