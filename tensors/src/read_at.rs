//! Bytes that can be read from any place.

use std::io;

/// Something whose bytes can be read from any place: a file on disk, or bytes in memory.
pub trait ReadAt {
    /// How many bytes there are.
    ///
    /// # Errors
    /// The error of the file system; and one when this is not a file.
    fn size(&self) -> io::Result<u64>;

    /// Fills `buffer` with the bytes from `place` on.
    ///
    /// # Errors
    /// The error of the file system; and one when there are fewer bytes.
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
