//! Recordings: reading them, what is wrong with them, and their videos.

mod copied_episodes;
mod delta_timestamps;
mod frames;
mod h264;
mod joint_unit;
mod metadata;
mod other_videos;
mod picture_digests;
mod pictures;
mod recover;
mod rename_map;
mod rows;
mod tables;
mod together;
mod video_fit;
mod videos;
