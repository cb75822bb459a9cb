//! Saves a recording that ended too early: a folder that LeRobot 0.6.1 loads, made of what the killed process left. A recording that
//! can be read is written anew as zk0 reads it: with the right places of the videos where a merge by LeRobot 0.4.0 to 0.4.2 has wrong
//! ones, and without the episodes that lack pictures.
//!
//! LeRobot writes the rows of an episode when the episode is saved, as a row group of `data/*/*.parquet`, and their footer and
//! `meta/episodes` when the recording ends. A process that is killed leaves data files without a footer, and no `meta/episodes`;
//! LeRobot loads nothing of that.
//!
//! ```text
//! tables::unfinished   bytes → row groups
//! rows                 rows → episodes
//! described            recording that can be read → which stretch of video belongs to which episode
//! placing              episodes, videos → which stretch of video belongs to which episode
//! leftovers            what a camera left: videos, and pictures that were not encoded yet
//! encode, mp4_index    those pictures as H.264
//! stored               pictures that the rows hold
//! statistics           mean, deviation and quantiles of the rows and the pictures
//! folder               episodes → files
//! save                 all of it, beside the new folder and then under its name
//! unfinished           tells such a recording from one that is damaged
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
