//! `zk0 dataset`: shows and checks recordings before training, and saves those that ended too early.

mod camera_names;
mod inspect;
mod recording_name;
mod recover;
mod validate;

use anyhow::Result;
use std::path::PathBuf;

pub use camera_names::CameraNames;
pub use recording_name::{of_recording, refuse_left_out, RecordingName};

/// What to do.
#[derive(Debug, clap::Subcommand)]
pub enum DatasetCommand {
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
    /// Read recordings to the last frame, decode every picture, compare the statistics with the rows, and list all faults. The exit code is 0
    /// if there are none, and 1 if there are any.
    Validate {
        /// The recordings: LeRobotDataset folders (v2.0, v2.1, v3.0), or hub:owner/name[@revision] on the Hugging Face Hub.
        #[arg(required = true)]
        recordings: Vec<RecordingName>,
    },
    /// Save the whole episodes of a recording whose process was ended, or whose videos and metadata do not fit (merges by LeRobot 0.4.0 to
    /// 0.4.2, dropped pictures): write a new folder that LeRobot loads, and list what was saved and what was lost. The recording itself is
    /// left as it is.
    Recover {
        /// The recording: a LeRobotDataset folder (v3.0).
        folder: PathBuf,
        /// The new folder. It must not be there yet.
        #[arg(long, value_name = "NEW")]
        out: PathBuf,
    },
}

/// Runs the command. Returns `false` if a recording has a fault.
pub fn run(command: &DatasetCommand) -> Result<bool> {
    match command {
        DatasetCommand::Inspect {
            recording,
            chunk,
            json,
        } => inspect::run(recording, *chunk, *json).map(|()| true),
        DatasetCommand::Validate { recordings } => validate::run(recordings),
        DatasetCommand::Recover { folder, out } => recover::run(folder, out).map(|()| true),
    }
}
