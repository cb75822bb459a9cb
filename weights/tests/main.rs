//! The tests of the files of weights.

mod files;
mod unread;
