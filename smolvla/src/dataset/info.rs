//! `meta/info.json`: what was recorded, how fast, and where the files lie.

use std::fmt;
use std::io::Read;
use std::path::{Component, Path, PathBuf};

use serde::de::{Deserializer, MapAccess, Visitor};
use serde::Deserialize;
use serde_json::Value;

use super::DatasetError;

/// A frame cap (92 hours at 30 fps) that keeps a false count from being believed.
pub(super) const MAX_FRAMES: usize = 10_000_000;
/// Largest metadata file read, in bytes.
const MAX_JSON: u64 = 16 << 20;
const MAX_SIDE: usize = 8192;
const MAX_DIM: usize = 4096;

pub(super) const STATE: &str = "observation.state";
pub(super) const ACTION: &str = "action";

/// The parts of `meta/info.json` that reading needs, checked.
#[derive(Debug, Clone)]
pub struct Info {
    /// Frames per second, at least 1.
    pub fps: u32,
    /// Robot, as LeRobot names it (`so100`, ...), where given.
    pub robot_type: Option<String>,
    /// Frames in all episodes together.
    pub total_frames: usize,
    /// Number of episodes.
    pub total_episodes: usize,
    /// Number of tasks.
    pub total_tasks: usize,
    /// `observation.state`.
    pub state: VectorFeature,
    /// `action`.
    pub action: VectorFeature,
    /// Video features in the file's order.
    pub cameras: Vec<Camera>,
    data_path: String,
    video_path: String,
}

/// A float32 vector recorded at every frame.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct VectorFeature {
    /// Number of values.
    pub dim: usize,
    /// Name of each value (joints), where given; otherwise empty.
    pub names: Vec<String>,
}

/// A camera: a video feature, 8-bit RGB once decoded.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Camera {
    /// Feature name, for example `observation.images.top`.
    pub name: String,
    /// Pixels from top to bottom.
    pub height: usize,
    /// Pixels from left to right.
    pub width: usize,
}

#[derive(Deserialize)]
struct RawInfo {
    fps: u32,
    robot_type: Option<String>,
    total_frames: usize,
    total_episodes: usize,
    total_tasks: usize,
    data_path: String,
    video_path: Option<String>,
    features: OrderedFeatures,
}

#[derive(Deserialize)]
struct RawFeature {
    dtype: String,
    shape: Vec<usize>,
    names: Option<Value>,
}

/// The cameras' order matters to the policy, so the map is kept as the list that it is written as.
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
    pub(super) fn read(root: &Path) -> Result<Self, DatasetError> {
        let path = root.join("meta/info.json");
        let text = read_json_text(&path)?;
        let broken = |cause: String| DatasetError::meta(&path, cause);

        // The version first: another version's file may lack what the rest of this one needs.
        let any: Value = serde_json::from_str(&text)
            .map_err(|e| broken(format!("is not the JSON it should be: {e}")))?;
        match any.get("codebase_version").and_then(Value::as_str) {
            Some("v3.0") => {}
            Some(found) => {
                return Err(DatasetError::Version {
                    path,
                    found: found.chars().take(40).collect(),
                    hint: "convert older recordings with LeRobot 0.4: \
                           python -m lerobot.datasets.v30.convert_dataset_v21_to_v30",
                })
            }
            None => {
                return Err(broken(
                    "has no codebase_version; is this a LeRobotDataset?".into(),
                ))
            }
        }
        let raw: RawInfo = serde_json::from_str(&text).map_err(|e| broken(e.to_string()))?;
        Self::check(raw).map_err(broken)
    }

    fn check(raw: RawInfo) -> Result<Self, String> {
        if raw.fps == 0 || raw.fps > 1000 {
            return Err(format!("fps is {}, expected 1 to 1000", raw.fps));
        }
        for (what, count) in [
            ("total_frames", raw.total_frames),
            ("total_episodes", raw.total_episodes),
            ("total_tasks", raw.total_tasks),
        ] {
            if count == 0 || count > MAX_FRAMES {
                return Err(format!("{what} is {count}, expected 1 to {MAX_FRAMES}"));
            }
        }
        let mut cameras: Vec<Camera> = Vec::new();
        let (mut state, mut action) = (None, None);
        for (name, feature) in raw.features.0 {
            match (name.as_str(), feature.dtype.as_str()) {
                (STATE, _) => state = Some(vector(&name, &feature)?),
                (ACTION, _) => action = Some(vector(&name, &feature)?),
                (_, "video") => {
                    if cameras.iter().any(|c| c.name == name) {
                        return Err(format!("feature {name} is there twice"));
                    }
                    cameras.push(camera(name, &feature)?);
                }
                (_, "image") => {
                    return Err(format!(
                        "feature {name} stores single images; only videos are read, record with use_videos"
                    ))
                }
                _ => {}
            }
        }
        if !cameras.is_empty() && raw.video_path.is_none() {
            return Err("has cameras but no video_path".into());
        }
        Ok(Self {
            fps: raw.fps,
            robot_type: raw.robot_type,
            total_frames: raw.total_frames,
            total_episodes: raw.total_episodes,
            total_tasks: raw.total_tasks,
            state: state.ok_or(format!("has no feature {STATE}"))?,
            action: action.ok_or(format!("has no feature {ACTION}"))?,
            cameras,
            data_path: raw.data_path,
            video_path: raw.video_path.unwrap_or_default(),
        })
    }

    /// Path of a data file, relative to the dataset's folder.
    pub(super) fn data_file(&self, chunk: u64, file: u64) -> Result<PathBuf, String> {
        fill(&self.data_path, "", chunk, file)
    }

    /// Path of a camera's video file, relative to the dataset's folder.
    pub(super) fn video_file(
        &self,
        camera: &str,
        chunk: u64,
        file: u64,
    ) -> Result<PathBuf, String> {
        fill(&self.video_path, camera, chunk, file)
    }
}

/// Reads a metadata file, unless it is far larger than such a file can be.
pub(super) fn read_json_text(path: &Path) -> Result<String, DatasetError> {
    let file = std::fs::File::open(path).map_err(|e| DatasetError::io(path, e))?;
    let mut text = String::new();
    file.take(MAX_JSON + 1)
        .read_to_string(&mut text)
        .map_err(|e| DatasetError::io(path, e))?;
    if text.len() as u64 > MAX_JSON {
        return Err(DatasetError::meta(
            path,
            format!("is larger than {MAX_JSON} bytes"),
        ));
    }
    Ok(text)
}

fn vector(name: &str, feature: &RawFeature) -> Result<VectorFeature, String> {
    if feature.dtype != "float32" {
        return Err(format!("{name} is {}, expected float32", feature.dtype));
    }
    match feature.shape[..] {
        [dim] if (1..=MAX_DIM).contains(&dim) => Ok(VectorFeature {
            dim,
            names: names(feature.names.as_ref()),
        }),
        _ => Err(format!(
            "{name} has shape {:?}, expected one dimension of 1 to {MAX_DIM}",
            feature.shape
        )),
    }
}

/// LeRobot writes a list of names, or a map of groups of them, or nothing.
fn names(value: Option<&Value>) -> Vec<String> {
    match value {
        Some(Value::String(name)) => vec![name.clone()],
        Some(Value::Array(items)) => items.iter().flat_map(|v| names(Some(v))).collect(),
        Some(Value::Object(groups)) => groups.values().flat_map(|v| names(Some(v))).collect(),
        _ => Vec::new(),
    }
}

fn camera(name: String, feature: &RawFeature) -> Result<Camera, String> {
    match feature.shape[..] {
        [height, width, 3]
            if (1..=MAX_SIDE).contains(&height) && (1..=MAX_SIDE).contains(&width) =>
        {
            Ok(Camera {
                name,
                height,
                width,
            })
        }
        _ => Err(format!(
            "{name} has shape {:?}, expected [height, width, 3] with sides of 1 to {MAX_SIDE}",
            feature.shape
        )),
    }
}

/// Fills LeRobot's path template; the result stays inside the dataset's folder.
fn fill(template: &str, camera: &str, chunk: u64, file: u64) -> Result<PathBuf, String> {
    let path = template
        .replace("{video_key}", camera)
        .replace("{chunk_index:03d}", &format!("{chunk:03}"))
        .replace("{file_index:03d}", &format!("{file:03}"));
    let inside = Path::new(&path)
        .components()
        .all(|c| matches!(c, Component::Normal(_)));
    if path.is_empty() || path.contains(['{', '}']) || !inside {
        return Err(format!(
            "path template {template:?} is not one that can be followed"
        ));
    }
    Ok(path.into())
}
