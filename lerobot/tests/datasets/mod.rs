//! Recordings: reading them, what is wrong with them, and their videos.

mod delta_timestamps;
mod frames;
mod h264;
mod metadata;
mod other_videos;
mod rows;
mod videos;
