//! How a store hands over the bytes of an object.

use super::error::BlobError;

/// Takes the bytes of an object, part after part.
pub type Take<'a> = &'a mut (dyn FnMut(&[u8]) -> Result<(), BlobError> + Send);
