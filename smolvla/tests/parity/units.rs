//! Single functions: resizing, the rotary and the time embedding.

use candle_core::Device;
use zk0_smolvla::frames::image::resize_with_pad;
use zk0_smolvla::policy::model::rope::Rope;
use zk0_smolvla::policy::model::time_embedding::time_embedding;
use zk0_smolvla::policy::profile::Profile;

use super::case::EARLY;
use crate::reference::{check, close, close_numbers, config, distance, is_committed, Values};

#[test]
fn configuration_is_read_from_lerobots_files() {
    let mut found = config();
    assert_eq!(found.camera_names.len(), found.cameras);
    found.validate().unwrap();
    if is_committed() {
        found.camera_names.clear();
        assert_eq!(found, Profile::Tiny.config());
    }
}

#[test]
fn images_are_resized_and_padded() {
    let units = Values::read("units.safetensors");
    let mut cases = 0;
    for name in units
        .names()
        .filter(|n| n.starts_with("resize_with_pad") && n.ends_with(".in"))
    {
        let out = name.replace(".in", ".out");
        let ([_, _, h, w], [_, _, oh, ow]) = (units.shape(name), units.shape(&out)) else {
            panic!("{name}")
        };
        let found = resize_with_pad(&units.f32s(name), (*h, *w), (*oh, *ow));
        close_numbers(&units, &out, &found, EARLY);
        cases += 1;
    }
    assert!(cases > 0, "the reference has sizes to try");
    if is_committed() {
        assert_eq!(cases, 5);
    }
}

#[test]
pub fn rotary_embedding() {
    let units = Values::read("units.safetensors");
    let tokens = units.shape("rope.positions")[1];
    let positions: Vec<Vec<i64>> = units
        .numbers("rope.positions")
        .chunks(tokens)
        .map(|row| row.iter().map(|p| *p as i64).collect())
        .collect();
    let input = units.tensor("rope.in");
    let rope = Rope::new(&positions, input.dim(3).unwrap(), &Device::Cpu).unwrap();
    close(&units, "rope.out", &rope.apply(&input).unwrap(), EARLY);
}

#[test]
fn time_embedding_in_double_precision() {
    let (units, config) = (Values::read("units.safetensors"), config());
    let widths: Vec<usize> = units
        .names()
        .filter_map(|name| name.strip_prefix("time_emb.")?.parse().ok())
        .collect();
    assert!(!widths.is_empty(), "the reference has widths to try");
    for width in widths {
        let found: Vec<f64> = units
            .f32s("time_emb.time")
            .iter()
            .flat_map(|t| time_embedding(*t, width, config.min_period, config.max_period))
            .collect();
        let name = format!("time_emb.{width}");
        check(&name, distance(&found, units.numbers(&name)), 1e-9);
    }
}
