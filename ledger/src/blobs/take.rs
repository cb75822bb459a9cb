//! How a store hands over the bytes of an object.

use super::error::BlobError;
use std::path::Path;

/// Takes the bytes of an object, part after part.
pub type Take<'a> = &'a mut (dyn FnMut(&[u8]) -> Result<(), BlobError> + Send);

/// A blob that is being read from the store into the folder.
#[derive(Clone, Copy, Debug)]
pub struct ArrivingBlob<'a> {
    /// The file that will hold it. Another name takes its place at the end.
    pub file: &'a Path,
    /// How many bytes the blob has.
    pub size: u64,
    /// How many of them the file holds. They are not verified.
    pub held: u64,
}

/// Hears how far a blob has come, and ends the reading with an error.
pub type Follow<'a> = &'a mut (dyn FnMut(ArrivingBlob<'_>) -> Result<(), BlobError> + Send);
