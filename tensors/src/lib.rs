//! Tensors in safetensors files, as plain `f32` numbers.
//!
//! - [`TensorData`] is one tensor, [`TensorSet`] several by name.
//! - [`TensorFile`] reads F32, F16 and BF16 tensors one by one, from disk or memory.
//! - [`write_to`] writes F32. Equal tensors give equal bytes. [`TensorHeader`] is for writers of other types.

mod error;
mod header;
mod number_types;
mod read_at;
mod tensor_data;
mod tensor_file;
mod writer;

pub use error::{Result, TensorError};
pub use header::{TensorHeader, HEADER_LIMIT};
pub use number_types::{check_readable, encode};
pub use read_at::ReadAt;
pub use safetensors::tensor::{Dtype, TensorInfo};
pub use tensor_data::{check_finite, check_layout, TensorData, TensorSet, TensorShapes};
pub use tensor_file::{TensorFile, BLOCK};
pub use writer::{write_to, TensorEntry, WrittenTensors};
