//! Recordings: reading them, what is wrong with them, and their videos.

mod copied_episodes;
mod delta_timestamps;
mod frames;
mod h264;
mod metadata;
mod rows;
mod video_fit;
mod videos;
