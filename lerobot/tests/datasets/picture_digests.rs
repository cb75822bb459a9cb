//! Digests of the pictures of `videos_and_rows`, row after row, camera after camera.

use std::fs;

use sha2::{Digest, Sha256};
use zk0_lerobot::dataset::Dataset;
use zk0_testkit::recordings::{fixtures, frames};

/// Of the right pictures: LeRobot 0.6.1 gave them.
pub fn expected(name: &str) -> Vec<[String; 2]> {
    let text = fs::read(fixtures().join("videos_and_rows/expected.json")).unwrap();
    let all: serde_json::Value = serde_json::from_slice(&text).unwrap();
    serde_json::from_value(all[name].clone()).unwrap()
}

/// Of ours.
pub fn pictures(dataset: &Dataset) -> Vec<[String; 2]> {
    let rows = frames(dataset, 1).map(|frame| {
        let digests = frame.unwrap().images.into_iter().map(|image| {
            let digest = Sha256::digest(image.pixels);
            digest[..8].iter().map(|b| format!("{b:02x}")).collect()
        });
        digests.collect::<Vec<String>>().try_into().unwrap()
    });
    rows.collect()
}
