//! Training, and resuming it.

mod flow_time;
mod resuming;
mod runs;
mod samples;
mod scene;
mod state_projection;
