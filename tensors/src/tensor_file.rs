//! A safetensors file, read tensor by tensor.
//!
//! Only the header stays in memory. Tensors are not mapped: mapped pages count as the process's memory, and another process that cuts the
//! file short would kill this one.

use std::collections::HashMap;

use safetensors::tensor::{Dtype, Metadata, SafeTensors, TensorInfo};

use crate::error::{Result, TensorError};
use crate::number_types::{check_readable, decode};
use crate::read_at::ReadAt;
use crate::tensor_data::{TensorData, TensorSet, TensorShapes};

/// Bytes read at once.
pub const BLOCK: usize = 1 << 20;
/// Bytes of the header's length, little endian.
const LENGTH: u64 = 8;

/// An open safetensors file.
#[derive(Debug)]
pub struct TensorFile<R> {
    source: R,
    header: Vec<u8>,
    metadata: Metadata,
}

impl<R: ReadAt> TensorFile<R> {
    /// Reads a header of at most `header_limit` bytes. Its size is checked before memory is allocated.
    ///
    /// # Errors
    /// The file cannot be read, is not a safetensors file, or does not have the length that its header states.
    pub fn open(source: R, header_limit: u64) -> Result<Self> {
        let size = source.size()?;
        let left = size
            .checked_sub(LENGTH)
            .ok_or(TensorError::NoHeader(size))?;
        let mut length = [0; LENGTH as usize];
        source.read_exact_at(&mut length, 0)?;
        let bytes = u64::from_le_bytes(length);
        if bytes > header_limit {
            return Err(TensorError::HeaderTooLarge {
                bytes,
                limit: header_limit,
            });
        }
        if bytes > left {
            return Err(TensorError::HeaderTruncated {
                header: bytes,
                left,
            });
        }
        let mut header = vec![0; bytes as usize];
        source.read_exact_at(&mut header, LENGTH)?;
        let metadata = parse(&header)?;
        if metadata.data_len() as u64 != left - bytes {
            return Err(TensorError::Length(size));
        }
        Ok(Self {
            source,
            header,
            metadata,
        })
    }

    /// The header's bytes.
    pub fn header(&self) -> &[u8] {
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

    /// The header's `__metadata__`.
    pub fn metadata(&self) -> &Option<HashMap<String, String>> {
        self.metadata.metadata()
    }

    /// An F32, F16 or BF16 tensor as `f32`, exactly. Its numbers need not be finite.
    ///
    /// # Errors
    /// [`TensorError::Missing`], [`TensorError::Dtype`], or [`TensorError::Io`].
    pub fn read(&self, name: &str) -> Result<TensorData> {
        let info = self.find(name)?;
        let bytes = check_readable(name, info.dtype)?;
        let (start, end) = info.data_offsets;
        // At most twice the file's size, because the header was checked against it.
        let mut data: Vec<f32> = Vec::with_capacity((end - start) / bytes);
        for block in self.blocks(name)? {
            decode(info.dtype, &block?, &mut data);
        }
        Ok(TensorData {
            shape: info.shape.clone(),
            data,
        })
    }

    /// An F32 tensor of this shape. Its numbers need not be finite.
    ///
    /// # Errors
    /// Those of [`Self::check`], or [`TensorError::Io`].
    pub fn read_f32(&self, name: &str, shape: &[usize]) -> Result<TensorData> {
        self.check(name, Dtype::F32, shape)?;
        self.read(name)
    }

    /// The numbers of an I16 tensor of this shape, row-major.
    ///
    /// # Errors
    /// Those of [`Self::read_f32`].
    pub fn read_i16(&self, name: &str, shape: &[usize]) -> Result<Vec<i16>> {
        self.check(name, Dtype::I16, shape)?;
        let (start, end) = self.find(name)?.data_offsets;
        let mut values = Vec::with_capacity((end - start) / 2);
        for block in self.blocks(name)? {
            let pairs = block?;
            let pairs = pairs.chunks_exact(2);
            values.extend(pairs.map(|pair| i16::from_le_bytes([pair[0], pair[1]])));
        }
        Ok(values)
    }

    /// Checks a tensor's presence, type and shape.
    ///
    /// # Errors
    /// [`TensorError::Missing`], [`TensorError::Dtype`], or [`TensorError::Shape`].
    pub fn check(&self, name: &str, dtype: Dtype, shape: &[usize]) -> Result<()> {
        let info = self.find(name)?;
        if info.dtype != dtype {
            return Err(TensorError::Dtype {
                name: name.into(),
                found: info.dtype.to_string(),
                accepted: dtype.to_string(),
            });
        }
        if info.shape == shape {
            Ok(())
        } else {
            Err(TensorError::Shape {
                name: name.into(),
                found: info.shape.clone(),
                expected: shape.to_vec(),
            })
        }
    }

    /// The tensors of a file with exactly those of `layout`, in F32 and finite. Those in `ignored` are allowed too.
    ///
    /// # Errors
    /// [`TensorError`] names the wrong tensor.
    pub fn read_exactly(&self, layout: &TensorShapes, ignored: &[&str]) -> Result<TensorSet> {
        let foreign = |n: &String| !layout.contains_key(n) && !ignored.contains(&n.as_str());
        if let Some(name) = self.names().into_iter().filter(foreign).min() {
            return Err(TensorError::Unexpected(name));
        }
        let read = |(name, shape): (&String, &Vec<usize>)| {
            let tensor = self.read_f32(name, shape)?.finite(name)?;
            Ok((name.clone(), tensor))
        };
        layout.iter().map(read).collect()
    }

    /// A tensor's bytes in blocks. All lengths but the last are multiples of 8.
    ///
    /// # Errors
    /// [`TensorError::Missing`]. Each block may be a [`TensorError::Io`].
    pub fn blocks(&self, name: &str) -> Result<impl Iterator<Item = Result<Vec<u8>>> + '_> {
        let (start, end) = self.find(name)?.data_offsets;
        let data = LENGTH + self.header.len() as u64;
        Ok((start..end).step_by(BLOCK).map(move |at| {
            let mut block = vec![0; BLOCK.min(end - at)];
            self.source.read_exact_at(&mut block, data + at as u64)?;
            Ok(block)
        }))
    }

    fn find(&self, name: &str) -> Result<&TensorInfo> {
        let info = self.info(name);
        info.ok_or_else(|| TensorError::Missing(name.into()))
    }
}

/// The library explains a bad header only if its length precedes it.
fn parse(header: &[u8]) -> Result<Metadata> {
    let text = str::from_utf8(header).ok();
    if let Some(metadata) = text.and_then(|text| serde_json::from_str(text).ok()) {
        return Ok(metadata);
    }
    let length = (header.len() as u64).to_le_bytes();
    match SafeTensors::read_metadata(&[&length, header].concat()) {
        Ok((_, metadata)) => Ok(metadata),
        Err(wrong) => Err(TensorError::Header(wrong.to_string())),
    }
}
