//! The files under `meta/`.

mod begun;
pub(crate) mod bounds;
pub(crate) mod episode;
mod episode_stats;
pub(crate) mod episodes;
mod episodes_v2;
pub(crate) mod info;
pub(crate) mod json;
pub(crate) mod normalizer;
pub(crate) mod paths;
pub(crate) mod stats;
pub(crate) mod tasks;
