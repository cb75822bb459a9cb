//! Recordings: reading them, what is wrong with them, and their videos.

#[path = "../mp4_writer/mod.rs"]
mod mp4_writer;
#[path = "../recordings/mod.rs"]
mod recordings;

mod delta_timestamps;
mod frames;
mod h264;
mod metadata;
mod rows;
mod videos;
