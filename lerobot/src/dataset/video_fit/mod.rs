//! Whether videos have a picture for every row: faults are repaired in memory, or the episode is left out.

pub(crate) mod merged_videos;
mod picture_times;
pub(crate) mod short_episodes;
