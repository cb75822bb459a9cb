//! Values in memory, or in a file that is mapped: then they are in memory only while somebody uses them.

use bytemuck::Pod;
use memmap2::{Mmap, UncheckedAdvice};
use std::io::{self, Write};
use std::marker::PhantomData;
use std::ops::Deref;
use std::path::Path;

/// Values of one kind.
#[derive(Debug)]
pub enum StoredValues<T> {
    /// In memory.
    Memory(Vec<T>),
    /// In a file that has no name, so that it is gone when nobody uses it, however the process ends.
    File(Mmap, PhantomData<T>),
}

impl<T: Pod> StoredValues<T> {
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

    /// Drops values that are in a file from the process's memory. Whoever uses them next reads them again.
    pub fn release(&self) {
        if let Self::File(map, _) = self {
            // SAFETY: the map is that of a file that nobody writes to, so that the same bytes are read again.
            // Where the system refuses, the values stay in memory, and nothing else changes.
            let _ = unsafe { map.unchecked_advise(UncheckedAdvice::DontNeed) };
        }
    }
}

impl<T: Pod> Deref for StoredValues<T> {
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

impl<T> From<Vec<T>> for StoredValues<T> {
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
        let stored = StoredValues::from(values.clone())
            .into_file(folder.path())
            .unwrap();
        assert!(matches!(stored, StoredValues::File(..)));
        assert_eq!(stored[..], values);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    /// How many of a process's pages of files are in memory, in bytes.
    fn resident_pages_of(stored: &StoredValues<i32>) -> usize {
        let start = stored.as_ptr() as usize;
        let maps = std::fs::read_to_string("/proc/self/smaps").unwrap();
        let mut lines = maps.lines();
        let of_this = |line: &str| line.starts_with(&format!("{start:x}-"));
        lines.find(|line| of_this(line)).unwrap();
        let resident = lines.find(|line| line.starts_with("Rss:")).unwrap();
        let kilobytes = resident.split_whitespace().nth(1).unwrap();
        kilobytes.parse::<usize>().unwrap() * 1024
    }

    #[test]
    fn values_in_a_file_are_in_memory_until_they_are_released() {
        let folder = tempfile::tempdir().unwrap();
        let values: Vec<i32> = (0..1 << 20).collect();
        let bytes = size_of_val(&values[..]);
        let stored = StoredValues::from(values).into_file(folder.path()).unwrap();
        for _ in 0..2 {
            assert_eq!(
                stored.iter().map(|&value| value as i64).sum::<i64>(),
                ((1 << 20) - 1) << 19
            );
            assert_eq!(resident_pages_of(&stored), bytes);
            stored.release();
            assert_eq!(resident_pages_of(&stored), 0);
        }
    }

    #[test]
    fn a_folder_that_is_not_there_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let stored = StoredValues::from(vec![1i16]);
        assert!(stored.into_file(&folder.path().join("missing")).is_err());
    }
}
