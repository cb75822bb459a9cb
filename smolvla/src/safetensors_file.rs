//! A safetensors file on disk, read tensor by tensor.
//!
//! Only its header is held in memory. Tensors are read at their place rather than mapped: mapped pages count as the process's
//! memory, and a file that another process cuts short would kill this one.

use std::collections::HashMap;
use std::fs::File;
use std::io::{self, Read};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use half::{bf16, f16};
use safetensors::tensor::{Dtype, Metadata, TensorInfo};

use crate::error::{PolicyError, Result};
use crate::weights::TensorData;

/// Bytes read or written at once.
pub(crate) const BLOCK: usize = 1 << 20;
/// Bytes before the header: its length.
const LENGTH: usize = 8;
/// What the format allows a header to be.
pub(crate) const HEADER_LIMIT: u64 = 100_000_000;
/// The types that [`TensorFile::read`] understands.
const READABLE: &str = "F32, F16 or BF16";

/// An open safetensors file.
#[derive(Debug)]
pub struct TensorFile {
    path: PathBuf,
    file: File,
    header: Vec<u8>,
    metadata: Metadata,
}

impl TensorFile {
    /// Opens a file and reads its header.
    ///
    /// # Errors
    /// [`PolicyError::AtPath`] when it cannot be read, is not safetensors, or is cut short.
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref().to_path_buf();
        let failed = |e: io::Error| PolicyError::file(&path, e);
        let mut file = File::open(&path).map_err(failed)?;
        let about = file.metadata().map_err(failed)?;
        if !about.is_file() {
            return Err(PolicyError::file(&path, "is not a file"));
        }
        let broken = |cause: String| {
            PolicyError::file(
                &path,
                format!("is not a complete safetensors file ({cause}); fetch or write it again"),
            )
        };
        let mut length = [0; LENGTH];
        file.read_exact(&mut length)
            .map_err(|_| broken(format!("it has {} bytes", about.len())))?;
        let length = u64::from_le_bytes(length);
        // Before anything is allocated for it.
        if length > HEADER_LIMIT || length > about.len().saturating_sub(LENGTH as u64) {
            return Err(broken(format!(
                "a header of {length} bytes in a file of {}",
                about.len()
            )));
        }
        let mut header = vec![0; length as usize];
        file.read_exact(&mut header)
            .map_err(|e| broken(e.to_string()))?;
        let text = std::str::from_utf8(&header).map_err(|e| broken(e.to_string()))?;
        let metadata: Metadata = serde_json::from_str(text).map_err(|e| broken(e.to_string()))?;
        let complete = (LENGTH as u64 + length).checked_add(metadata.data_len() as u64);
        if complete != Some(about.len()) {
            return Err(broken(format!(
                "it has {} bytes, its header tells of {} after itself",
                about.len(),
                metadata.data_len()
            )));
        }
        Ok(Self {
            path,
            file,
            header,
            metadata,
        })
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The header's bytes, as they are.
    pub(crate) fn header(&self) -> &[u8] {
        &self.header
    }

    /// Names in the order of their data.
    pub fn names(&self) -> Vec<String> {
        self.metadata.offset_keys()
    }

    /// Type, shape and place of a tensor.
    pub fn info(&self, name: &str) -> Option<&TensorInfo> {
        self.metadata.info(name)
    }

    /// The `__metadata__` of the header.
    pub fn metadata(&self) -> &Option<HashMap<String, String>> {
        self.metadata.metadata()
    }

    /// A tensor as `f32`; exact for all three types that are read (F32, F16, BF16).
    ///
    /// # Errors
    /// [`PolicyError::MissingTensor`], [`PolicyError::Dtype`], [`PolicyError::NotFinite`], or [`PolicyError::AtPath`] when reading
    /// fails.
    pub fn read(&self, name: &str) -> Result<TensorData> {
        let info = self
            .info(name)
            .ok_or_else(|| PolicyError::MissingTensor(name.into()).within(&self.path))?;
        let dtype = info.dtype;
        let bytes = readable_size(dtype).ok_or_else(|| self.unreadable(name, dtype))?;
        let (start, end) = info.data_offsets;
        // Not more than twice what is in the file: the header was checked against its length.
        let mut data: Vec<f32> = Vec::with_capacity((end - start) / bytes);
        self.each_block(name, &mut |block| {
            decode(dtype, block, &mut data);
            Ok(())
        })?;
        if let Some(index) = data.iter().position(|x| !x.is_finite()) {
            let error = PolicyError::NotFinite {
                name: name.into(),
                index,
                value: data[index],
            };
            return Err(error.within(&self.path));
        }
        Ok(TensorData {
            shape: info.shape.clone(),
            data,
        })
    }

    /// Gives the bytes of a tensor to `take`, in blocks whose length is a multiple of 8 but for the last.
    pub(crate) fn each_block(
        &self,
        name: &str,
        take: &mut dyn FnMut(&[u8]) -> Result<()>,
    ) -> Result<()> {
        let info = self
            .info(name)
            .ok_or_else(|| PolicyError::MissingTensor(name.into()).within(&self.path))?;
        let (start, end) = info.data_offsets;
        let mut buffer = vec![0; BLOCK.min(end - start)];
        let mut at = start;
        while at < end {
            let block = &mut buffer[..BLOCK.min(end - at)];
            let place = (LENGTH + self.header.len() + at) as u64;
            self.file
                .read_exact_at(block, place)
                .map_err(|e| PolicyError::file(&self.path, format!("tensor `{name}`: {e}")))?;
            take(block)?;
            at += block.len();
        }
        Ok(())
    }

    /// Refuses a tensor whose type cannot be read.
    pub(crate) fn unreadable(&self, name: &str, dtype: Dtype) -> PolicyError {
        PolicyError::Dtype {
            name: name.into(),
            found: dtype.to_string(),
            accepted: READABLE,
        }
        .within(&self.path)
    }
}

/// Bytes of an element, for the types that are read.
pub(crate) fn readable_size(dtype: Dtype) -> Option<usize> {
    match dtype {
        Dtype::F32 => Some(4),
        Dtype::F16 | Dtype::BF16 => Some(2),
        _ => None,
    }
}

fn decode(dtype: Dtype, block: &[u8], out: &mut Vec<f32>) {
    let pairs = block.chunks_exact(2).map(|b| [b[0], b[1]]);
    match dtype {
        Dtype::F16 => out.extend(pairs.map(|b| f16::from_le_bytes(b).to_f32())),
        Dtype::BF16 => out.extend(pairs.map(|b| bf16::from_le_bytes(b).to_f32())),
        // F32, the only other one that `readable_size` lets through.
        _ => out.extend(
            block
                .chunks_exact(4)
                .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])),
        ),
    }
}

/// Numbers as bytes of a type that can be read, rounded to nearest even; `None` where one gets too large for it.
pub(crate) fn encode(dtype: Dtype, numbers: &[f32]) -> Option<Vec<u8>> {
    let mut out = Vec::with_capacity(numbers.len() * readable_size(dtype)?);
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
