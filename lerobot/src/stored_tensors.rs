//! A safetensors file on disk; errors name it.

use std::fs::File;
use std::ops::Deref;
use std::path::{Path, PathBuf};

use zk0_tensors::{TensorData, TensorError, TensorFile, HEADER_LIMIT};

use crate::error::{Result, StoredPolicyError};

/// An open safetensors file and its path.
#[derive(Debug)]
pub struct StoredTensors {
    path: PathBuf,
    file: TensorFile<File>,
}

impl StoredTensors {
    /// Opens a file and reads its header.
    ///
    /// # Errors
    /// [`StoredPolicyError::AtPath`] when it is unreadable, cut, or not safetensors.
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref().to_path_buf();
        let source = File::open(&path).map_err(|e| StoredPolicyError::file(&path, e))?;
        match TensorFile::open(source, HEADER_LIMIT) {
            Ok(file) => Ok(Self { path, file }),
            Err(wrong) => Err(at(&path, wrong)),
        }
    }

    /// The file's path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// A tensor as finite `f32` numbers.
    ///
    /// # Errors
    /// [`StoredPolicyError::AtPath`] when it is missing, unreadable, not finite, or of an unsupported type.
    pub fn read(&self, name: &str) -> Result<TensorData> {
        let tensor = self.file.read(name).and_then(|tensor| tensor.finite(name));
        tensor.map_err(|wrong| at(&self.path, wrong))
    }

    /// A tensor's bytes, in blocks.
    pub(crate) fn blocks(&self, name: &str) -> Result<impl Iterator<Item = Result<Vec<u8>>> + '_> {
        let blocks = self.file.blocks(name).map_err(|e| at(&self.path, e))?;
        Ok(blocks.map(|block| block.map_err(|e| at(&self.path, e))))
    }
}

impl Deref for StoredTensors {
    type Target = TensorFile<File>;

    fn deref(&self) -> &TensorFile<File> {
        &self.file
    }
}

fn at(path: &Path, wrong: TensorError) -> StoredPolicyError {
    match wrong {
        TensorError::Io(cause) => StoredPolicyError::file(path, cause),
        wrong => StoredPolicyError::from(wrong).within(path),
    }
}
