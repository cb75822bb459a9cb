//! A test that changes a limit of the whole process.

mod full_disk;
