//! Reads a recording: `read_recording FOLDER`, such as `tests/fixtures/datasets/so100_pickplace`. Prints what it holds, and its first frame.

use std::env;
use std::error::Error;
use zk0_lerobot::dataset::Dataset;

fn main() -> Result<(), Box<dyn Error>> {
    let folder = env::args().nth(1).ok_or("usage: read_recording FOLDER")?;
    let recording = Dataset::open(folder)?;
    println!(
        "{} frames in {} episodes, {} a second; tasks: {:?}",
        recording.len(),
        recording.episodes().len(),
        recording.fps(),
        recording.tasks()
    );
    // A policy's 50 actions from this frame on.
    let frame = recording.loader(50)?.frame(0)?;
    for (camera, image) in recording.cameras().iter().zip(&frame.images) {
        println!(
            "{}: {} by {} pixels",
            camera.name, image.width, image.height
        );
    }
    println!(
        "state {:?}, then {} numbers of actions",
        frame.state,
        frame.actions.len()
    );
    Ok(())
}
