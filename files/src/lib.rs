//! How all crates of zk0 write and read their files.
//!
//! - [`atomic_file`]: writes a file whole or not at all.
//! - [`bounded_file`]: reads a file up to a limit.
//! - [`random_number`]: numbers for unique names.

pub mod atomic_file;
pub mod bounded_file;
pub mod random_number;
