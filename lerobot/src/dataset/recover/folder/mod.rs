//! Writes a recording's folder, v3.0, which LeRobot 0.6.1 reads and extends.
//!
//! ```text
//! recording        what is written
//! filmed           videos, and statistics of their pictures
//! rows             data files, with pictures in rows
//! episode_table    meta/episodes
//! table            how tables are written
//! write            all of it
//! ```

mod episode_table;
mod filmed;
pub(crate) mod recording;
mod rows;
mod table;
pub(crate) mod write;
