//! Recordings: a reader of LeRobotDataset folders, v2.0, v2.1 and v3.0.
//!
//! ```text
//! meta/info.json                  metadata::info      frames per second, features, where the files are (paths)
//! meta/stats.json                 metadata::stats     statistics of states and actions
//! meta/tasks.parquet              metadata::tasks     task strings
//! meta/episodes/*/*.parquet       metadata::episodes  each episode's rows and stretches of video
//! data/*/*.parquet                tables::motion      states, actions, timestamps
//! videos/*/*/*.mp4                video_fit           whether every row has its picture
//! videos/*/*/*.mp4                video               a camera's frames: mp4 finds, av1, h264 or ffmpeg decodes, color makes RGB
//! data/*/*.parquet, images/       picture             or stored frames, PNG or JPEG: tables::pictures finds them
//! ```
//!
//! In v2.x `meta` holds `tasks.jsonl` and `episodes.jsonl` (`episodes_v2`), in v2.1 also `episodes_stats.jsonl` (`episode_stats`). Every
//! episode has its own parquet file and videos.
//!
//! [`Dataset::open`] reads and checks everything but the pixels. [`Dataset::repairs`] lists the faults it corrected, [`Dataset::left_out`]
//! the episodes it left out. [`Dataset::loader`] gives [`Frame`]s as LeRobot's `LeRobotDataset.__getitem__` does under SmolVLA's
//! `delta_timestamps` (observations now, a chunk of actions from now on). [`Loader::new`] takes any other [`Window`].
//!
//! [`recover()`] saves a recording that ended too early, or whose videos and metadata do not fit.
//!
//! Formats: LeRobot 0.4 to 0.6 (`codebase_version` v3.0, <https://huggingface.co/docs/lerobot/lerobot-dataset-v3>) and LeRobot 0.3 (v2.1).

mod copied_episodes;
mod episode_digest;
mod error;
mod feature_spec;
mod joint_unit;
mod loader;
mod metadata;
mod picture;
mod recording;
mod recover;
mod rename_map;
mod repair;
mod statistics_fault;
mod tables;
mod together;
mod validate;
mod video;
mod video_fit;
mod window;

pub use copied_episodes::CopiedEpisodes;
pub use error::DatasetError;
pub use feature_spec::FEATURE_SPEC_TAG;
pub use joint_unit::JointUnit;
pub use loader::{Frame, Image, Loader};
pub use metadata::episode::{Episode, VideoSpan};
pub use metadata::info::{Camera, CameraStorage, FormatVersion, Info, VectorFeature};
pub use metadata::normalizer::{Normalizer, Stats};
pub use recording::Dataset;
pub use recover::{recover, Lost, Recovered, Saved};
pub use rename_map::{whole_name, RenameMap};
pub use repair::Repair;
pub use statistics_fault::StatisticsFault;
pub use together::refuse_different;
pub use validate::PictureFault;
pub use video::color::{rgb_from_yuv, ColorMatrix, Colors, Sampling, Yuv, YuvFormat};
pub use video::mp4::nal_config::NalConfig;
pub use video::mp4::sample::{ContainerColors, Mp4Codec, Mp4Sample};
pub use video::mp4::track::Mp4Track;
pub use video::mp4::turn::Rotation;
pub use video::reader::VideoReader;
pub use video_fit::short_episodes::LeftOut;
pub use window::Window;
