//! Tests that put a limit on their whole process, and have one of their own.

mod full_disk;
mod open_files;
