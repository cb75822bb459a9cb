//! Number formats: F32, F16 and BF16.

use half::{bf16, f16};
use safetensors::tensor::Dtype;

use crate::error::{Result, TensorError};

/// The bytes of an element, if the type is readable.
///
/// # Errors
/// [`TensorError::Dtype`] about tensor `name`.
pub fn check_readable(name: &str, dtype: Dtype) -> Result<usize> {
    match dtype {
        Dtype::F32 => Ok(4),
        Dtype::F16 | Dtype::BF16 => Ok(2),
        _ => Err(TensorError::Dtype {
            name: name.into(),
            found: dtype.to_string(),
            accepted: "F32, F16 or BF16".into(),
        }),
    }
}

pub(crate) fn decode(dtype: Dtype, block: &[u8], out: &mut Vec<f32>) {
    let pairs = block.chunks_exact(2).map(|b| [b[0], b[1]]);
    match dtype {
        Dtype::F16 => out.extend(pairs.map(|b| f16::from_le_bytes(b).to_f32())),
        Dtype::BF16 => out.extend(pairs.map(|b| bf16::from_le_bytes(b).to_f32())),
        // F32: `check_readable` lets no other type through.
        _ => out.extend(
            block
                .chunks_exact(4)
                .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])),
        ),
    }
}

/// Numbers as bytes of a readable type, rounded to nearest even; `None` if one is too large.
pub fn encode(dtype: Dtype, numbers: &[f32]) -> Option<Vec<u8>> {
    let mut out = Vec::with_capacity(numbers.len() * dtype.bitsize() / 8);
    for x in numbers {
        match dtype {
            Dtype::F16 => {
                let rounded = f16::from_f32(*x);
                if !rounded.is_finite() {
                    return None;
                }
                out.extend(rounded.to_le_bytes());
            }
            Dtype::BF16 => {
                let rounded = bf16::from_f32(*x);
                if !rounded.is_finite() {
                    return None;
                }
                out.extend(rounded.to_le_bytes());
            }
            _ => out.extend(x.to_le_bytes()),
        }
    }
    Some(out)
}
