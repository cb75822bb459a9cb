//! Values in memory, or in a file that is mapped: then the system drops them from memory where it needs room, and reads them again.

use bytemuck::Pod;
use memmap2::Mmap;
use std::io::{self, Write};
use std::marker::PhantomData;
use std::ops::Deref;
use std::path::Path;

/// Values of one kind.
#[derive(Debug)]
pub enum Stored<T> {
    /// In memory.
    Memory(Vec<T>),
    /// In a file that has no name, so that it is gone when nobody uses it, however the process ends.
    File(Mmap, PhantomData<T>),
}

impl<T: Pod> Stored<T> {
    /// Moves the values to a file in a folder.
    pub fn into_file(self, folder: &Path) -> io::Result<Self> {
        let Self::Memory(values) = self else {
            return Ok(self);
        };
        let mut file = tempfile::tempfile_in(folder)?;
        file.write_all(bytemuck::cast_slice(&values))?;
        // SAFETY: no other process can open a file without a name, and this one writes to it no more.
        let map = unsafe { Mmap::map(&file)? };
        Ok(Self::File(map, PhantomData))
    }
}

impl<T: Pod> Deref for Stored<T> {
    type Target = [T];

    #[inline(always)]
    fn deref(&self) -> &[T] {
        match self {
            Self::Memory(values) => values,
            // A mapping begins with a page, so that it is aligned.
            Self::File(map, _) => bytemuck::cast_slice(map),
        }
    }
}

impl<T> From<Vec<T>> for Stored<T> {
    fn from(values: Vec<T>) -> Self {
        Self::Memory(values)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_the_same_in_a_file() {
        let folder = tempfile::tempdir().unwrap();
        let values: Vec<i32> = (-5000..5000).collect();
        let stored = Stored::from(values.clone())
            .into_file(folder.path())
            .unwrap();
        assert!(matches!(stored, Stored::File(..)));
        assert_eq!(stored[..], values);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn a_folder_that_is_not_there_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let stored = Stored::from(vec![1i16]);
        assert!(stored.into_file(&folder.path().join("missing")).is_err());
    }
}
