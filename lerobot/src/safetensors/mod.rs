//! Tensors in safetensors files, as plain `f32` numbers.
//!
//! - [`TensorData`] is one tensor, [`TensorSet`] several by name.
//! - [`TensorFile`] is a file on disk that is read tensor by tensor; it takes F32, F16 and BF16.
//! - [`read_exactly`] and [`read_f32`] read bytes in memory that must hold given tensors in F32.
//! - [`write_to`] writes tensors in F32. Equal tensors give equal bytes.

mod bytes;
mod file;
mod number_types;
mod tensors;
mod writer;

pub use bytes::{metadata_of, read_exactly, read_f32};
pub use file::TensorFile;
pub use tensors::{check_finite, check_layout, TensorData, TensorSet};
pub use writer::{write_to, Entry, Written};

pub(crate) use file::BLOCK;
pub(crate) use number_types::{encode, readable_size};
pub(crate) use tensors::check_shape;
