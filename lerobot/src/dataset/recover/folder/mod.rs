//! Writes the folder of a recording, v3.0, as LeRobot 0.6.1 reads it and records on in it.
//!
//! ```text
//! recording        what is to be written
//! filmed           videos, and the statistics of their pictures
//! rows             data files, with the pictures that rows hold
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
