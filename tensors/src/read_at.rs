//! Random access to bytes.

use std::io;

/// Bytes with random access: a file on disk, or memory.
pub trait ReadAt {
    /// The number of bytes.
    ///
    /// # Errors
    /// The file system's error, or this is not a file.
    fn size(&self) -> io::Result<u64>;

    /// Fills `buffer` with the bytes from `place` on.
    ///
    /// # Errors
    /// The file system's error, or there are fewer bytes.
    fn read_exact_at(&self, buffer: &mut [u8], place: u64) -> io::Result<()>;
}

#[cfg(unix)]
impl ReadAt for std::fs::File {
    fn size(&self) -> io::Result<u64> {
        let about = self.metadata()?;
        if about.is_file() {
            Ok(about.len())
        } else {
            Err(io::Error::other("is not a file"))
        }
    }

    fn read_exact_at(&self, buffer: &mut [u8], place: u64) -> io::Result<()> {
        std::os::unix::fs::FileExt::read_exact_at(self, buffer, place)
    }
}

impl ReadAt for &[u8] {
    fn size(&self) -> io::Result<u64> {
        Ok(self.len() as u64)
    }

    fn read_exact_at(&self, buffer: &mut [u8], place: u64) -> io::Result<()> {
        let from = usize::try_from(place).ok();
        let range = from.and_then(|from| Some(from..from.checked_add(buffer.len())?));
        match range.and_then(|range| self.get(range)) {
            Some(bytes) => buffer.copy_from_slice(bytes),
            None => return Err(io::ErrorKind::UnexpectedEof.into()),
        }
        Ok(())
    }
}
