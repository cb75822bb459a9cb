//! The tests of traces.

mod carried;
