//! Training, and resuming it.

mod flow_time;
mod resuming;
mod samples;
mod scene;
mod state_projection;
mod training;
