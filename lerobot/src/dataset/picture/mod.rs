//! Pictures stored one by one, PNG or JPEG.

pub(crate) mod decode;
mod jpeg;
mod orientation;
mod png;
mod size;
