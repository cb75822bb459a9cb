//! The tests of event files.

mod event_files;
mod full_disk;
