//! `zk0 dataset inspect`: shows a recording as a table or JSON.

use super::RecordingName;
use crate::output::{print, println};
use anyhow::{Context, Result};
use serde::Serialize;
use zk0_lerobot::dataset::{Dataset, Frame, JointUnit, Normalizer, VectorFeature, VideoReader};
use zk0_protocol::counted::counted;

/// Prints the content of `recording`.
pub fn run(recording: &RecordingName, chunk: usize, json: bool) -> Result<()> {
    let dataset = Dataset::open(recording.locate()?)?;
    let summary = RecordingSummary::of(&dataset, chunk)?;
    if json {
        println!("{}", serde_json::to_string_pretty(&summary)?)
    } else {
        print!("{}", summary.table(recording))
    }
    Ok(())
}

#[derive(Serialize)]
struct RecordingSummary {
    folder: String,
    format: &'static str,
    robot: Option<String>,
    fps: u32,
    episodes: usize,
    /// The shortest and the longest.
    episode_frames: [usize; 2],
    frames: usize,
    seconds: f64,
    cameras: Vec<CameraSummary>,
    /// Distances, which are not read.
    depth_maps: Vec<String>,
    joint_unit: JointUnit,
    joint_unit_because: String,
    state: Vec<JointSummary>,
    action: Vec<JointSummary>,
    tasks: Vec<Task>,
    repairs: Vec<String>,
    /// Because they have fewer pictures than rows.
    left_out: Vec<String>,
    sample: SampleSummary,
}

/// In place of a codec, for single PNG or JPEG pictures.
const PICTURES: &str = "pictures";

#[derive(Serialize)]
struct CameraSummary {
    name: String,
    height: usize,
    width: usize,
    /// Or [`PICTURES`].
    codec: &'static str,
    /// Average distance of the first video's key frames.
    frames_per_key: f64,
}

#[derive(Serialize)]
struct JointSummary {
    name: String,
    mean: f32,
    std: f32,
    min: f32,
    max: f32,
}

#[derive(Serialize)]
struct Task {
    frames: usize,
    task: String,
}

#[derive(Serialize)]
struct SampleSummary {
    task: String,
    tensors: Vec<TensorSummary>,
}

#[derive(Serialize)]
struct TensorSummary {
    name: String,
    dtype: &'static str,
    shape: Vec<usize>,
    range: [f32; 2],
}

impl RecordingSummary {
    fn of(dataset: &Dataset, chunk: usize) -> Result<Self> {
        let info = dataset.info();
        let lengths = || dataset.episodes().iter().map(|e| e.frames.len());
        let stats = dataset.stats();
        let (joint_unit, joint_unit_because) = dataset.joint_unit();
        let first = dataset
            .frame(0, chunk)
            .context("a sample of the recording")?;
        Ok(Self {
            folder: dataset.root().display().to_string(),
            format: info.format.name(),
            robot: info.robot_type.clone(),
            fps: dataset.fps(),
            episodes: dataset.episodes().len(),
            episode_frames: [lengths().min().unwrap_or(0), lengths().max().unwrap_or(0)],
            frames: dataset.len(),
            seconds: dataset.len() as f64 / f64::from(dataset.fps()),
            cameras: cameras(dataset)?,
            depth_maps: info.depth_maps.clone(),
            joint_unit,
            joint_unit_because,
            state: joints(&info.state, &stats.state, dataset.len(), |at| {
                dataset.state(at)
            }),
            action: joints(&info.action, &stats.action, dataset.len(), |at| {
                dataset.action(at)
            }),
            tasks: dataset
                .tasks()
                .iter()
                .zip(dataset.frames_per_task())
                .map(|(task, frames)| Task {
                    frames,
                    task: task.clone(),
                })
                .collect(),
            repairs: dataset.repairs().iter().map(ToString::to_string).collect(),
            left_out: dataset.left_out().iter().map(ToString::to_string).collect(),
            sample: sample(dataset, first),
        })
    }

    fn table(&self, recording: &RecordingName) -> String {
        let mut text = String::new();
        let mut line = |label: &str, value: &str| text.push_str(&format!("{label:<10} {value}\n"));
        let recording = recording.to_string();
        line("recording", &recording);
        if self.folder != recording {
            line("folder", &self.folder);
        }
        line("format", &format!("LeRobotDataset {}", self.format));
        line(
            "robot",
            self.robot
                .as_deref()
                .unwrap_or("the recording does not state"),
        );
        let [shortest, longest] = self.episode_frames;
        line(
            "episodes",
            &format!("{} of {shortest} to {longest} frames", self.episodes),
        );
        let frames = format!(
            "{} at {} frames per second: {}",
            self.frames,
            self.fps,
            duration(self.seconds)
        );
        line("frames", &frames);
        let widest = longest_name(self.cameras.iter().map(|c| &c.name));
        for (i, c) in self.cameras.iter().enumerate() {
            let stored = match c.codec {
                PICTURES => "pictures in place of a video".into(),
                codec => format!("{codec}, a key frame every {:.1} frames", c.frames_per_key),
            };
            let value = format!(
                "{:<widest$}  {} x {} (height x width), {stored}",
                c.name, c.height, c.width
            );
            line(if i == 0 { "cameras" } else { "" }, &value);
        }
        for name in &self.depth_maps {
            line("not read", &format!("{name:?}: a depth map"));
        }
        let unit = format!("{}: {}", self.joint_unit.name(), self.joint_unit_because);
        line("unit", &unit);
        for (i, task) in self.tasks.iter().enumerate() {
            let frames = counted(task.frames as u64, "frame", "frames");
            let value = format!("{frames}: {}", task.task);
            line(if i == 0 { "tasks" } else { "" }, &value);
        }
        match &self.repairs[..] {
            [] => line("repairs", "none needed"),
            repairs => repairs.iter().for_each(|repair| line("REPAIRED", repair)),
        }
        self.left_out.iter().for_each(|one| line("LEFT OUT", one));
        let names = self.state.iter().chain(&self.action).map(|j| &j.name);
        let widest = longest_name(names).max(18);
        for (title, joints) in [("observation.state", &self.state), ("action", &self.action)] {
            text.push_str(&format!(
                "\n{title:<widest$} {:>10} {:>10} {:>10} {:>10}\n",
                "mean", "std", "min", "max"
            ));
            for j in joints {
                text.push_str(&format!(
                    "{:<widest$} {:>10.3} {:>10.3} {:>10.3} {:>10.3}\n",
                    j.name, j.mean, j.std, j.min, j.max
                ));
            }
        }
        let tensors = &self.sample.tensors;
        let widest = longest_name(tensors.iter().map(|t| &t.name));
        text.push_str(&format!(
            "\na sample for training (the first frame): {:?}\n",
            self.sample.task
        ));
        for t in tensors {
            text.push_str(&format!(
                "{:<widest$}  {:<7} {:<15} {:.2} to {:.2}\n",
                t.name,
                t.dtype,
                format!("{:?}", t.shape),
                t.range[0],
                t.range[1]
            ));
        }
        text
    }
}

fn longest_name<'a>(names: impl Iterator<Item = &'a String>) -> usize {
    names.map(|name| name.chars().count()).max().unwrap_or(0)
}

fn cameras(dataset: &Dataset) -> Result<Vec<CameraSummary>> {
    let first = dataset.episodes().first();
    dataset
        .cameras()
        .iter()
        .enumerate()
        .map(|(i, camera)| {
            let span = first
                .and_then(|episode| episode.videos.get(i))
                .with_context(|| {
                    format!("{}: no video of {}", dataset.root().display(), camera.name)
                })?;
            let (codec, frames_per_key) = match span {
                Some(span) => {
                    let video = VideoReader::open(&span.path, camera.height, camera.width)?;
                    let distance = video.len() as f64 / video.key_frames() as f64;
                    (video.codec().name(), distance)
                }
                None => (PICTURES, 1.0),
            };
            Ok(CameraSummary {
                name: camera.name.clone(),
                height: camera.height,
                width: camera.width,
                codec,
                frames_per_key,
            })
        })
        .collect()
}

fn joints<'a>(
    feature: &VectorFeature,
    normalizer: &Normalizer,
    frames: usize,
    row: impl Fn(usize) -> Option<&'a [f32]>,
) -> Vec<JointSummary> {
    (0..feature.dim)
        .map(|dim| {
            let values = (0..frames).filter_map(|frame| Some(row(frame)?[dim]));
            let [min, max] = range(values);
            JointSummary {
                name: feature
                    .names
                    .get(dim)
                    .cloned()
                    .unwrap_or_else(|| dim.to_string()),
                mean: normalizer.mean()[dim],
                std: normalizer.std()[dim],
                min,
                max,
            }
        })
        .collect()
}

/// Normalised. The policy itself resizes pictures.
fn sample(dataset: &Dataset, mut frame: Frame) -> SampleSummary {
    let stats = dataset.stats();
    stats.state.normalize(&mut frame.state);
    stats.action.normalize(&mut frame.actions);
    let mut tensors: Vec<TensorSummary> = dataset
        .cameras()
        .iter()
        .zip(&frame.images)
        .map(|(camera, image)| TensorSummary {
            name: camera.name.clone(),
            dtype: "uint8",
            shape: vec![3, image.height, image.width],
            range: range(image.pixels.iter().map(|&p| p.into())),
        })
        .collect();
    tensors.push(TensorSummary {
        name: "observation.state".into(),
        dtype: "float32",
        shape: vec![frame.state.len()],
        range: range(frame.state.iter().copied()),
    });
    tensors.push(TensorSummary {
        name: "action".into(),
        dtype: "float32",
        shape: vec![frame.action_is_pad.len(), dataset.info().action.dim],
        range: range(frame.actions.iter().copied()),
    });
    tensors.push(TensorSummary {
        name: "action_is_pad".into(),
        dtype: "bool",
        shape: vec![frame.action_is_pad.len()],
        range: range(frame.action_is_pad.iter().map(|&p| u8::from(p).into())),
    });
    SampleSummary {
        task: frame.task,
        tensors,
    }
}

fn range(values: impl Iterator<Item = f32>) -> [f32; 2] {
    values.fold([f32::INFINITY, f32::NEG_INFINITY], |[min, max], v| {
        [min.min(v), max.max(v)]
    })
}

/// `8.2 s`, `12.5 min`, `3.1 h`.
fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 100.0 => format!("{s:.1} s"),
        s if s < 6000.0 => format!("{:.1} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}
