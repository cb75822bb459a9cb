//! What breaks in a round costs time, and no node its standing.

mod lost_files;
mod outages;
