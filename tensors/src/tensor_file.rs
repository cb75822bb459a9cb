//! A safetensors file, read tensor by tensor.
//!
//! Only its header is held in memory. Tensors of a file on disk are read at their place rather than mapped: mapped pages count as
//! the process's memory, and a file that another process cuts short would kill this one.

use std::collections::HashMap;

use safetensors::tensor::{Dtype, Metadata, SafeTensors, TensorInfo};

use crate::error::{Result, TensorError};
use crate::number_types::{check_readable, decode};
use crate::read_at::ReadAt;
use crate::tensor_data::{TensorData, TensorSet, TensorShapes};

/// Bytes read at once.
pub const BLOCK: usize = 1 << 20;
/// Bytes before the header: its length, little endian.
const LENGTH: u64 = 8;

/// An open safetensors file.
#[derive(Debug)]
pub struct TensorFile<R> {
    source: R,
    header: Vec<u8>,
    metadata: Metadata,
}

impl<R: ReadAt> TensorFile<R> {
    /// Reads the header of a file, which may have `header_limit` bytes. Its size is checked before anything is allocated for it.
    ///
    /// # Errors
    /// The file cannot be read, is not a safetensors file, or is shorter or longer than its header says.
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

    /// The header's bytes, as they are.
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

    /// The `__metadata__` of the header.
    pub fn metadata(&self) -> &Option<HashMap<String, String>> {
        self.metadata.metadata()
    }

    /// A tensor as `f32`, exact for all three types that are read (F32, F16, BF16). Its numbers need not be finite.
    ///
    /// # Errors
    /// [`TensorError::Missing`], [`TensorError::Dtype`], or [`TensorError::Io`].
    pub fn read(&self, name: &str) -> Result<TensorData> {
        let info = self.find(name)?;
        let bytes = check_readable(name, info.dtype)?;
        let (start, end) = info.data_offsets;
        // This is at most twice the size of the file, because the header was checked against the file's length.
        let mut data: Vec<f32> = Vec::with_capacity((end - start) / bytes);
        for block in self.blocks(name)? {
            decode(info.dtype, &block?, &mut data);
        }
        Ok(TensorData {
            shape: info.shape.clone(),
            data,
        })
    }

    /// A tensor that must be F32 and of this shape. Its numbers need not be finite.
    ///
    /// # Errors
    /// [`TensorError::Missing`], [`TensorError::Dtype`], [`TensorError::Shape`], or [`TensorError::Io`].
    pub fn read_f32(&self, name: &str, shape: &[usize]) -> Result<TensorData> {
        self.check(name, Dtype::F32, shape)?;
        self.read(name)
    }

    /// The numbers of a tensor that must be I16 and of this shape, row-major.
    ///
    /// # Errors
    /// [`TensorError::Missing`], [`TensorError::Dtype`], [`TensorError::Shape`], or [`TensorError::Io`].
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

    /// Checks that a tensor is there, of this type and shape.
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

    /// The tensors of a file that must hold exactly those of `layout`, in F32 and finite. Those named in `ignored` may be there too.
    ///
    /// # Errors
    /// Says which tensor is missing, unexpected, of another shape or type, or not finite.
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

    /// The bytes of a tensor, in blocks whose length is a multiple of 8 but for the last.
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

/// Reads a header. The library names what is wrong with one only when it has the file's beginning, length and all.
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
