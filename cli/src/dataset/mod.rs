//! `zk0 dataset`: look at recordings, and check them, before training on them.

mod inspect;
mod recording_name;
mod validate;

use anyhow::Result;

pub use recording_name::{refuse_left_out, RecordingName};

/// What to do.
#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Show what a recording holds: the robot, the cameras, the joints with their statistics, the tasks, and a sample as training sees it.
    Inspect {
        /// The recording: a LeRobotDataset folder (v2.0, v2.1, v3.0), or hub:owner/name[@revision] on the Hugging Face Hub.
        recording: RecordingName,
        /// The number of frames in an action chunk. It depends on the policy that you want to train.
        #[arg(long, default_value_t = 50)]
        chunk: usize,
        /// Print JSON.
        #[arg(long)]
        json: bool,
    },
    /// Read recordings to the last frame, decode every picture, and list all faults. The exit code is 0 if there are none, and 1 if there
    /// are any.
    Validate {
        /// The recordings: LeRobotDataset folders (v2.0, v2.1, v3.0), or hub:owner/name[@revision] on the Hugging Face Hub.
        #[arg(required = true)]
        recordings: Vec<RecordingName>,
    },
}

/// Runs the command. Returns `false` if a recording has a fault.
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
