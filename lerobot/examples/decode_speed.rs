//! Pictures decoded a second, from video files or from the fixtures' AV1 and the same pictures as H.264.
//!
//! ```sh
//! cargo run --release -p zk0-smolvla --example decode_speed [-- FILE.mp4 …]
//! ```

#[path = "../tests/mp4_writer/mod.rs"]
mod mp4_writer;

use std::error::Error;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::Instant;

use zk0_lerobot::dataset::{Mp4Track, VideoReader};

fn open(path: &Path) -> Result<VideoReader, Box<dyn Error>> {
    let track = Mp4Track::read(&mut File::open(path)?)?;
    Ok(VideoReader::open(path, track.height, track.width)?)
}

/// Decodes all of it in order, five times; prints the fastest.
fn measure(name: &str, path: &Path) -> Result<(), Box<dyn Error>> {
    let track = Mp4Track::read(&mut File::open(path)?)?;
    let mut fastest = f64::INFINITY;
    let mut pictures = 0;
    let mut codec = "";
    for _ in 0..5 {
        let mut video = open(path)?;
        codec = video.codec().name();
        let start = Instant::now();
        pictures = video.len();
        for number in 0..pictures {
            std::hint::black_box(video.rgb(number)?);
        }
        fastest = fastest.min(start.elapsed().as_secs_f64());
    }
    println!(
        "{name}: {pictures} pictures of {} x {}, {codec}: {:.0} a second",
        track.height,
        track.width,
        pictures as f64 / fastest
    );
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    let files: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    for file in &files {
        measure(&file.display().to_string(), file)?;
    }
    if files.is_empty() {
        let av1 = Path::new(env!("CARGO_MANIFEST_DIR")).join(
            "../tests/fixtures/datasets/so100_pickplace/videos/observation.images.top/chunk-000/file-000.mp4",
        );
        measure("fixture", &av1)?;
        let mut video = open(&av1)?;
        let pictures = (0..video.len())
            .map(|number| video.rgb(number))
            .collect::<Result<Vec<_>, _>>()?;
        let profile = openh264::encoder::Profile::High;
        let folder = tempfile::tempdir()?;
        for period in [2, 30] {
            let path = folder.path().join(format!("{period}.mp4"));
            let stream = mp4_writer::encode(&pictures, 96, 128, profile, period);
            std::fs::write(&path, stream.mp4(96, 128))?;
            measure(&format!("the same, a key frame every {period}"), &path)?;
        }
    }
    Ok(())
}
