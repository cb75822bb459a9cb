//! How every crate of zk0 writes and reads its own files on disk.
//!
//! - [`atomic_file`]: a file is written whole or not at all, and is on disk before anybody is told so.
//! - [`bounded_file`]: a file is read up to a limit, so that a file that is too long costs no memory.
//! - [`random_number`]: numbers for names that no other process uses.

pub mod atomic_file;
pub mod bounded_file;
pub mod random_number;
