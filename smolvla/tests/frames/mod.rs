//! Frames of recordings as samples, and the cache of samples.

mod ahead;
mod prefix_cache;
mod recording;
mod setting;
