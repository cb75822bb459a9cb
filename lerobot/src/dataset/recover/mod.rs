//! Saves a recording that ended too early: makes a folder that LeRobot 0.6.1 loads from what the killed process left. A readable recording
//! is written as zk0 reads it: without episodes that lack pictures, and with corrected video places after a merge by LeRobot 0.4.0 to
//! 0.4.2.
//!
//! LeRobot writes a saved episode's rows as a row group of `data/*/*.parquet`, and the footer and `meta/episodes` when the recording ends.
//! A killed process leaves neither of these, and LeRobot does not load the folder.
//!
//! ```text
//! tables::unfinished   bytes → row groups
//! rows                 rows → episodes
//! described            readable recording → each episode's stretch of video
//! placing              episodes, videos → each episode's stretch of video
//! leftovers            what a camera left: videos, and pictures not encoded yet
//! encode, mp4_index    those pictures as H.264
//! stored               pictures in rows
//! statistics           mean, deviation and quantiles of rows and pictures
//! folder               episodes → files
//! save                 all of it, beside the new folder, then renamed
//! unfinished           tells such a recording from a damaged one
//! ```

mod described;
mod encode;
mod episodes;
mod folder;
mod json_in_order;
mod leftovers;
mod mp4_index;
mod placing;
mod report;
mod rows;
mod save;
mod source;
mod statistics;
mod stored;
pub(crate) mod unfinished;

pub use report::{Lost, Recovered, Saved};
pub use save::recover;
