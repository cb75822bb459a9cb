//! A safetensors file on disk, read tensor by tensor.
//!
//! Only its header is held in memory. Tensors are read at their place rather than mapped: mapped pages count as the process's
//! memory, and a file that another process cuts short would kill this one.

use std::collections::HashMap;
use std::fs::File;
use std::io::{self, Read};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use safetensors::tensor::{Dtype, Metadata, TensorInfo};

use super::number_types::{decode, readable_size};
use super::tensors::{check_finite, TensorData};
use crate::error::{Result, StoredPolicyError};

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
    /// [`StoredPolicyError::AtPath`] when it cannot be read, is not safetensors, or is cut short.
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref().to_path_buf();
        let failed = |e: io::Error| StoredPolicyError::file(&path, e);
        let mut file = File::open(&path).map_err(failed)?;
        let about = file.metadata().map_err(failed)?;
        if !about.is_file() {
            return Err(StoredPolicyError::file(&path, "is not a file"));
        }
        let broken = |cause: String| {
            StoredPolicyError::file(
                &path,
                format!("is not a complete safetensors file ({cause}); fetch or write it again"),
            )
        };
        let mut length = [0; LENGTH];
        file.read_exact(&mut length)
            .map_err(|_| broken(format!("it has {} bytes", about.len())))?;
        let length = u64::from_le_bytes(length);
        // The length is checked before anything is allocated for the header.
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
    /// [`StoredPolicyError::MissingTensor`], [`StoredPolicyError::Dtype`], [`StoredPolicyError::NotFinite`], or [`StoredPolicyError::AtPath`] when reading
    /// fails.
    pub fn read(&self, name: &str) -> Result<TensorData> {
        let info = self
            .info(name)
            .ok_or_else(|| StoredPolicyError::MissingTensor(name.into()).within(&self.path))?;
        let dtype = info.dtype;
        let bytes = readable_size(dtype).ok_or_else(|| self.unreadable(name, dtype))?;
        let (start, end) = info.data_offsets;
        // This is at most twice the size of the file, because the header was checked against the file's length.
        let mut data: Vec<f32> = Vec::with_capacity((end - start) / bytes);
        self.each_block(name, &mut |block| {
            decode(dtype, block, &mut data);
            Ok::<_, StoredPolicyError>(())
        })?;
        check_finite(name, &data).map_err(|e| e.within(&self.path))?;
        Ok(TensorData {
            shape: info.shape.clone(),
            data,
        })
    }

    /// Gives the bytes of a tensor to `take`, in blocks whose length is a multiple of 8 but for the last.
    pub(crate) fn each_block<E: From<StoredPolicyError>>(
        &self,
        name: &str,
        take: &mut dyn FnMut(&[u8]) -> std::result::Result<(), E>,
    ) -> std::result::Result<(), E> {
        let info = self
            .info(name)
            .ok_or_else(|| StoredPolicyError::MissingTensor(name.into()).within(&self.path))?;
        let (start, end) = info.data_offsets;
        let mut buffer = vec![0; BLOCK.min(end - start)];
        let mut at = start;
        while at < end {
            let block = &mut buffer[..BLOCK.min(end - at)];
            let place = (LENGTH + self.header.len() + at) as u64;
            self.file.read_exact_at(block, place).map_err(|e| {
                StoredPolicyError::file(&self.path, format!("tensor `{name}`: {e}"))
            })?;
            take(block)?;
            at += block.len();
        }
        Ok(())
    }

    /// Refuses a tensor whose type cannot be read.
    pub(crate) fn unreadable(&self, name: &str, dtype: Dtype) -> StoredPolicyError {
        StoredPolicyError::Dtype {
            name: name.into(),
            found: dtype.to_string(),
            accepted: READABLE,
        }
        .within(&self.path)
    }
}
