//! `meta/info.json`: what was recorded, how fast, and where the files are.

use std::fmt;
use std::path::{Path, PathBuf};

use serde::de::{Deserializer, MapAccess, Visitor};
use serde::Deserialize;
use serde_json::Value;

use crate::dataset::metadata::begun;
use crate::dataset::metadata::json::{self, read_text};
use crate::dataset::metadata::paths::{fill, RecordingFile};
use crate::dataset::DatasetError;

/// Most frames (92 hours at 30 fps): a false count is not believed.
pub(crate) const MAX_FRAMES: usize = 10_000_000;
const MAX_SIDE: usize = 8192;
const MAX_DIM: usize = 4096;

const DATA_PATH: &str = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet";
const VIDEO_PATH: &str = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4";

pub(crate) const STATE: &str = "observation.state";
pub(crate) const ACTION: &str = "action";

/// Version of LeRobotDataset's format, `codebase_version`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum FormatVersion {
    /// One parquet file and one video per episode; statistics in `meta/stats.json`.
    V20,
    /// As [`FormatVersion::V20`], with statistics per episode in `meta/episodes_stats.jsonl`.
    V21,
    /// Episodes share files; metadata in parquet.
    V30,
}

impl FormatVersion {
    const ALL: [Self; 3] = [Self::V20, Self::V21, Self::V30];

    /// As in `codebase_version`: `v2.0`, `v2.1`, `v3.0`.
    pub fn name(self) -> &'static str {
        match self {
            Self::V20 => "v2.0",
            Self::V21 => "v2.1",
            Self::V30 => "v3.0",
        }
    }
}

impl fmt::Display for FormatVersion {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// The parts of `meta/info.json` that reading needs, checked.
#[derive(Debug, Clone)]
pub struct Info {
    /// The folder's format version.
    pub format: FormatVersion,
    /// Frames per second, at least 1.
    pub fps: u32,
    /// Robot, as LeRobot names it (`so100`, ...), if given.
    pub robot_type: Option<String>,
    /// Frames of all episodes.
    pub total_frames: usize,
    /// Number of episodes.
    pub total_episodes: usize,
    /// `observation.state`.
    pub state: VectorFeature,
    /// `action`.
    pub action: VectorFeature,
    /// Features of videos or pictures, in the file's order.
    pub cameras: Vec<Camera>,
    /// Features that hold distances (depth cameras of LeRobot 0.6). SmolVLA takes colours, so they are not read.
    pub depth_maps: Vec<String>,
    /// Episodes per folder of v2.x, at least 1.
    chunks_size: u64,
    data_path: String,
    video_path: String,
}

/// A vector per frame, read as float32.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct VectorFeature {
    /// Number of values.
    pub dim: usize,
    /// Name of each value (joint), if given; else empty.
    pub names: Vec<String>,
}

/// How a camera's pictures are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CameraStorage {
    /// As frames of mp4 files.
    Video,
    /// One by one, PNG or JPEG, in the data files or in files that these name (`use_videos=False`).
    Pictures,
}

/// A camera: a feature of videos or pictures, decoded to 8-bit RGB.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Camera {
    /// Its name, for example `observation.images.top`: the feature's, or that of [`Dataset::renamed`](crate::dataset::Dataset::renamed).
    pub name: String,
    /// The feature's name in the files.
    pub(crate) feature: String,
    /// Pixels from top to bottom.
    pub height: usize,
    /// Pixels from left to right.
    pub width: usize,
    /// How its pictures are stored.
    pub storage: CameraStorage,
}

#[derive(Deserialize)]
struct RawInfo {
    #[serde(deserialize_with = "json::whole_number")]
    fps: u32,
    robot_type: Option<String>,
    #[serde(deserialize_with = "json::whole_number")]
    total_frames: usize,
    #[serde(deserialize_with = "json::whole_number")]
    total_episodes: usize,
    #[serde(default, deserialize_with = "json::whole_number_or_none")]
    chunks_size: Option<u64>,
    data_path: Option<String>,
    video_path: Option<String>,
    features: OrderedFeatures,
}

#[derive(Deserialize)]
struct RawFeature {
    dtype: String,
    #[serde(deserialize_with = "json::whole_numbers")]
    shape: Vec<usize>,
    names: Option<Value>,
    /// LeRobot's notes on a video, read by key because their form has changed.
    info: Option<Value>,
}

impl RawFeature {
    fn is_depth_map(&self) -> bool {
        let reports = |key: &str| {
            let info = self.info.as_ref();
            info.and_then(|info| info.get(key)).and_then(Value::as_bool) == Some(true)
        };
        reports("is_depth_map") || reports("video.is_depth_map")
    }
}

/// Kept as a list, because the cameras' order matters to the policy.
struct OrderedFeatures(Vec<(String, RawFeature)>);

impl<'de> Deserialize<'de> for OrderedFeatures {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct InOrder;
        impl<'de> Visitor<'de> for InOrder {
            type Value = OrderedFeatures;
            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("a map from feature name to feature")
            }
            fn visit_map<M: MapAccess<'de>>(self, mut map: M) -> Result<Self::Value, M::Error> {
                let mut features = Vec::new();
                while let Some(entry) = map.next_entry()? {
                    features.push(entry);
                }
                Ok(OrderedFeatures(features))
            }
        }
        deserializer.deserialize_map(InOrder)
    }
}

impl Info {
    /// Reads and checks `meta/info.json` under `root`.
    ///
    /// # Errors
    /// The folder or file is missing, or a value cannot be read.
    pub fn read(root: &Path) -> Result<Self, DatasetError> {
        if !root.is_dir() {
            return Err(DatasetError::NoFolder { path: root.into() });
        }
        if !root.join("meta").is_dir() {
            return Err(DatasetError::NoRecording { path: root.into() });
        }
        let path = root.join("meta/info.json");
        let text = read_text(&path)?;
        match begun::fault(root, &text) {
            Some(fault) => Err(fault),
            None => Self::parse(&path, &text),
        }
    }

    pub(crate) fn parse(path: &Path, text: &str) -> Result<Self, DatasetError> {
        let broken = |cause: String| DatasetError::meta(path, cause);

        // The version comes first: another version may lack the other fields.
        let any: Value =
            json::parse(text).map_err(|e| broken(format!("is not the JSON it should be: {e}")))?;
        let Some(version) = any.get("codebase_version").and_then(Value::as_str) else {
            return Err(broken(
                "has no codebase_version; is this a LeRobotDataset?".into(),
            ));
        };
        let Some(format) = FormatVersion::ALL.into_iter().find(|f| f.name() == version) else {
            return Err(DatasetError::Version {
                path: path.into(),
                found: version.chars().take(40).collect(),
            });
        };
        let raw: RawInfo = json::parse(text).map_err(|e| broken(e.to_string()))?;
        Self::check(format, raw).map_err(broken)
    }

    fn check(format: FormatVersion, raw: RawInfo) -> Result<Self, String> {
        if raw.fps == 0 || raw.fps > 1000 {
            return Err(format!("fps is {}, expected 1 to 1000", raw.fps));
        }
        for (what, count) in [
            ("total_frames", raw.total_frames),
            ("total_episodes", raw.total_episodes),
        ] {
            if count == 0 || count > MAX_FRAMES {
                return Err(format!("{what} is {count}, expected 1 to {MAX_FRAMES}"));
            }
        }
        // LeRobot's default.
        let chunks_size = raw.chunks_size.unwrap_or(1000);
        if chunks_size == 0 {
            return Err("chunks_size is 0, expected at least 1".into());
        }
        let mut cameras: Vec<Camera> = Vec::new();
        let mut depth_maps = Vec::new();
        let (mut state, mut action) = (None, None);
        for (name, feature) in raw.features.0 {
            match (name.as_str(), feature.dtype.as_str()) {
                (STATE, _) => state = Some(vector(&name, &feature)?),
                (ACTION, _) => action = Some(vector(&name, &feature)?),
                (_, "video" | "image") if feature.is_depth_map() => depth_maps.push(name),
                (_, kind @ ("video" | "image")) => {
                    if cameras.iter().any(|c| c.name == name) {
                        return Err(format!("feature {} is there twice", quoted(&name)));
                    }
                    let storage = match kind {
                        "video" => CameraStorage::Video,
                        _ => CameraStorage::Pictures,
                    };
                    cameras.push(camera(name, &feature, storage)?);
                }
                _ => {}
            }
        }
        // LeRobot's defaults in v3.0.
        let path_of_v30 = |path: &str| (format == FormatVersion::V30).then(|| path.to_owned());
        let data_path = raw.data_path.or_else(|| path_of_v30(DATA_PATH));
        let video_path = raw.video_path.or_else(|| path_of_v30(VIDEO_PATH));
        let mut storages = cameras.iter().map(|camera| camera.storage);
        if video_path.is_none() && storages.any(|s| s == CameraStorage::Video) {
            return Err("has videos but no video_path".into());
        }
        Ok(Self {
            format,
            fps: raw.fps,
            robot_type: raw.robot_type,
            total_frames: raw.total_frames,
            total_episodes: raw.total_episodes,
            state: state.ok_or(format!("has no feature {STATE}"))?,
            action: action.ok_or(format!("has no feature {ACTION}"))?,
            cameras,
            depth_maps,
            chunks_size,
            data_path: data_path.ok_or("has no data_path")?,
            video_path: video_path.unwrap_or_default(),
        })
    }

    /// The file of an episode in v2.x.
    pub(crate) fn place_of_episode(&self, episode: u64) -> RecordingFile {
        RecordingFile::OfEpisode {
            chunk: episode / self.chunks_size,
            episode,
        }
    }

    pub(crate) fn data_file(
        &self,
        root: &Path,
        place: RecordingFile,
    ) -> Result<PathBuf, DatasetError> {
        in_folder(root, fill(&self.data_path, "", place))
    }

    /// The file must exist.
    pub(crate) fn video_file(
        &self,
        root: &Path,
        camera: &Camera,
        place: RecordingFile,
    ) -> Result<PathBuf, DatasetError> {
        let path = in_folder(root, fill(&self.video_path, &camera.feature, place))?;
        if !path.is_file() {
            return Err(DatasetError::MissingFile { path });
        }
        Ok(path)
    }
}

fn in_folder(root: &Path, relative: Result<PathBuf, String>) -> Result<PathBuf, DatasetError> {
    match relative {
        Ok(path) => Ok(root.join(path)),
        Err(cause) => Err(DatasetError::meta(root.join("meta/info.json"), cause)),
    }
}

fn vector(name: &str, feature: &RawFeature) -> Result<VectorFeature, String> {
    // All widths are read as float32.
    if !["float16", "float32", "float64"].contains(&&feature.dtype[..]) {
        return Err(format!(
            "{name} is {}, expected float32",
            quoted(&feature.dtype)
        ));
    }
    match feature.shape[..] {
        [dim] if (1..=MAX_DIM).contains(&dim) => Ok(VectorFeature {
            dim,
            names: names(feature.names.as_ref()),
        }),
        _ => Err(format!(
            "{name} has shape {}, expected one dimension of 1 to {MAX_DIM}",
            shape(feature)
        )),
    }
}

/// A stranger's text for a message: one short line.
fn quoted(text: &str) -> String {
    format!("{:?}", text.chars().take(60).collect::<String>())
}

fn shape(feature: &RawFeature) -> String {
    match feature.shape.len() {
        0..=8 => format!("{:?}", feature.shape),
        many => format!("of {many} dimensions"),
    }
}

/// LeRobot writes a list of names, a map of groups, or nothing.
fn names(value: Option<&Value>) -> Vec<String> {
    match value {
        Some(Value::String(name)) => vec![name.clone()],
        Some(Value::Array(items)) => items.iter().flat_map(|v| names(Some(v))).collect(),
        Some(Value::Object(groups)) => groups.values().flat_map(|v| names(Some(v))).collect(),
        _ => Vec::new(),
    }
}

fn camera(name: String, feature: &RawFeature, storage: CameraStorage) -> Result<Camera, String> {
    // Older recordings put channels first; their videos are the same.
    let names = names(feature.names.as_ref());
    let channels_first = names.first().is_some_and(|n| n.starts_with("channel"));
    let sides = match feature.shape[..] {
        [3, height, width] if channels_first => Some((height, width)),
        [height, width, 3] if !channels_first => Some((height, width)),
        _ => None,
    };
    let fits = |side: &usize| (1..=MAX_SIDE).contains(side);
    match sides.filter(|(height, width)| fits(height) && fits(width)) {
        Some((height, width)) => Ok(Camera {
            feature: name.clone(),
            name,
            height,
            width,
            storage,
        }),
        None => Err(format!(
            "{} has shape {}, expected [height, width, 3] with sides of 1 to {MAX_SIDE}",
            quoted(&name),
            shape(feature)
        )),
    }
}
