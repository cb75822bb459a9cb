//! `zk0 dataset`: look at recordings before training on them.

mod inspect;
mod source;
mod validate;

use anyhow::Result;

pub use source::RecordingName;

/// What to do.
#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Show what a recording holds: robot, cameras, joints with their statistics, tasks, and what training sees of it.
    Inspect {
        /// The recording: a LeRobotDataset folder (v2.0, v2.1, v3.0), or hub:owner/name[@revision] on the Hugging Face Hub.
        recording: RecordingName,
        /// Frames of an action chunk, as the policy to be trained predicts them.
        #[arg(long, default_value_t = 50)]
        chunk: usize,
        /// Print JSON.
        #[arg(long)]
        json: bool,
    },
    /// Read recordings to the last frame, decoding every picture, and list all that is wrong. Exit code 0 if nothing is, 1 if
    /// anything is.
    Validate {
        /// Recordings, as for inspect.
        #[arg(required = true)]
        recordings: Vec<RecordingName>,
    },
}

/// Runs the command; `false` when a recording has a fault.
pub fn run(command: &Command) -> Result<bool> {
    match command {
        Command::Inspect {
            recording,
            chunk,
            json,
        } => inspect::run(recording, *chunk, *json).map(|()| true),
        Command::Validate { recordings } => validate::run(recordings),
    }
}
