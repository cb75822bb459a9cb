//! The policy acts on one sample at a time. It turns 8-bit pictures, the raw state and token ids into a chunk of actions.

use candle_core::Device;
use zk0_lerobot::dataset::{Normalizer, Stats};
use zk0_lerobot::error::Result;
use zk0_lerobot::tokenizer::Tokenizer;
use zk0_smolvla::frames::sample::{CameraImage, Pixels};
use zk0_smolvla::policy::model::PolicyParameters;

use super::case::{last_frames, Case, SAMPLED};
use crate::actor::{Actor, Scene};
use crate::reference::{check, distance, is_of_repository, policy};

/// The reference's token ids of one sample.
struct Given(Vec<u32>);

impl Tokenizer for Given {
    fn tokens(&self, _: &str) -> Result<Vec<u32>> {
        Ok(self.0.clone())
    }
}

/// One camera of the reference: its name, height, width, and the pictures of all samples.
struct Camera {
    name: String,
    height: usize,
    width: usize,
    pixels: Vec<Vec<u8>>,
    present: Vec<bool>,
}

fn cameras(case: &Case) -> Option<Vec<Camera>> {
    let inputs = &case.inputs;
    let mut cameras = Vec::new();
    for name in &case.config().camera_names {
        let key = format!("batch.{name}");
        if !inputs.contains(&key) {
            continue;
        }
        let shape = inputs.shape(&key);
        let (height, width) = (shape[shape.len() - 2], shape[shape.len() - 1]);
        let frame = 3 * height * width;
        let last = last_frames(&inputs.f32s(&key), frame, case.batch());
        if last
            .iter()
            .any(|x| (x * 255.0 - (x * 255.0).round()).abs() > 1e-3)
        {
            return None;
        }
        let bytes: Vec<u8> = last.iter().map(|x| (x * 255.0).round() as u8).collect();
        let padding = format!("{key}_padding_mask");
        cameras.push(Camera {
            name: name.clone(),
            height,
            width,
            pixels: bytes.chunks(frame).map(<[u8]>::to_vec).collect(),
            present: match inputs.contains(&padding) {
                true => inputs.flags(&padding),
                false => vec![true; case.batch()],
            },
        });
    }
    Some(cameras)
}

#[test]
pub fn action_chunks_from_observations() {
    let case = Case::read();
    let (config, inputs) = (case.config(), &case.inputs);
    let Some(cameras) = cameras(&case) else {
        assert!(!is_of_repository(), "the repository's pictures are 8-bit");
        println!("the reference's pictures are not 8-bit ones: an actor cannot be shown them");
        return;
    };
    let policy = policy();
    let mut all = policy.frozen;
    all.extend(policy.expert.into_tensors());
    let parameters = PolicyParameters::take(all, &Device::Cpu).unwrap();
    let unit = |dim: usize| Normalizer::new(vec![0.0; dim], vec![1.0; dim]).unwrap();

    let states = last_frames(
        &inputs.f32s("batch.observation.state"),
        config.state_dim,
        case.batch(),
    );
    let tokens = inputs.numbers("batch.observation.language.tokens");
    let mask = inputs.mask("batch.observation.language.attention_mask");
    let noise = inputs.f32s("sample_noise");
    let expected = case.outputs.numbers("sample.action_chunk");
    let rows = config.chunk_size * config.action_dim;
    let mut compared = 0;
    for b in 0..case.batch() {
        let real = tokens
            .chunks(mask[b].len())
            .nth(b)
            .unwrap()
            .iter()
            .zip(&mask[b]);
        let tokenizer = Given(
            real.filter(|(_, m)| **m)
                .map(|(id, _)| *id as u32)
                .collect(),
        );
        let stats = Stats {
            state: unit(config.state_dim),
            action: unit(config.action_dim),
        };
        let steps = case.lerobot.num_steps;
        let actor = Actor::new(config, &parameters, &tokenizer, stats, steps).unwrap();
        // A camera that is declared padding is one that this robot lacks.
        let seen = cameras.iter().filter(|camera| camera.present[b]);
        let scene = Scene {
            cameras: seen
                .map(|camera| CameraImage {
                    name: &camera.name,
                    height: camera.height,
                    width: camera.width,
                    pixels: Pixels::Bytes(&camera.pixels[b]),
                })
                .collect(),
            state: &states[b * config.state_dim..][..config.state_dim],
            task: "given as token ids",
        };
        if scene.cameras.is_empty() {
            continue; // An actor needs at least one picture
        }
        let noise = &noise[b * config.chunk_elements()..][..config.chunk_elements()];
        let found = actor.action_chunk(&scene, noise).unwrap();
        let found: Vec<f64> = found.into_iter().map(f64::from).collect();
        let expected = &expected[b * rows..][..rows];
        check(
            &format!("action chunk of sample {b}"),
            distance(&found, expected),
            SAMPLED,
        );
        compared += 1;
    }
    if is_of_repository() {
        assert_eq!(compared, case.batch(), "every sample has a camera");
    }
}
