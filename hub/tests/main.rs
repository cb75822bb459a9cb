//! The tests of publishing.

mod hub_uploads;
