//! Frames of recordings as samples, and the cache of samples.

mod prefix_cache;
mod recording;
