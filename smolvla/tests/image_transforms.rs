//! Image transforms give what torchvision gives for the same parameters, are configured as in LeRobot, and follow from a seed.

use std::collections::HashSet;

use rand::SeedableRng;
use rand_chacha::ChaCha20Rng;
use safetensors::SafeTensors;
use serde_json::{json, Value};
use zk0_lerobot::dataset::Dataset;
use zk0_smolvla::frames::batch::SampleSource;
use zk0_smolvla::frames::image_transforms::{
    AffineTransform, ImageTransformsConfig, Picture, Transform, Variants,
};
use zk0_smolvla::frames::prefix_cache::{
    DiskCache, FrameMaker, FrameNames, FrameRef, FrameSource, KeySpace,
};
use zk0_smolvla::frames::sample::{PreparedSample, Preparer};
use zk0_smolvla::policy::frozen::FrozenPlace;
use zk0_smolvla::policy::init::init_policy;
use zk0_smolvla::policy::profile::Profile;
use zk0_smolvla::policy::tokenizer::WordHash;
use zk0_smolvla::PolicyError;

use crate::reference::fixtures;

fn transform(name: &str, values: &[f64]) -> Transform {
    match (name, values) {
        ("brightness", [factor]) => Transform::Brightness(*factor as f32),
        ("contrast", [factor]) => Transform::Contrast(*factor as f32),
        ("saturation", [factor]) => Transform::Saturation(*factor as f32),
        ("hue", [turn]) => Transform::Hue(*turn as f32),
        ("sharpness", [factor]) => Transform::Sharpness(*factor as f32),
        ("affine", [angle, x, y, scale, shear_x, shear_y]) => Transform::Affine(AffineTransform {
            angle: *angle,
            translate: [*x, *y],
            scale: *scale,
            shear: [*shear_x, *shear_y],
        }),
        other => panic!("{other:?}"),
    }
}

/// The file is made by scripts/image-transforms/run.sh.
#[test]
fn transforms_give_what_torchvision_gives() {
    let bytes = std::fs::read(fixtures().join("image_transforms/reference.safetensors")).unwrap();
    let (_, header) = SafeTensors::read_metadata(&bytes).unwrap();
    let cases = &header.metadata().as_ref().unwrap()["cases"];
    let cases: Vec<Vec<(String, Vec<f64>)>> = serde_json::from_str(cases).unwrap();
    let tensors = SafeTensors::deserialize(&bytes).unwrap();
    let picture = tensors.tensor("picture").unwrap();
    let [3, height, width] = *picture.shape() else {
        panic!("{:?}", picture.shape());
    };
    let mut changed = HashSet::new();
    for (number, case) in cases.iter().enumerate() {
        let before = Picture::of_bytes(height, width, picture.data());
        let mut ours = before.clone();
        for (name, values) in case {
            transform(name, values).apply(&mut ours);
            changed.insert(name.clone());
        }
        let expected = tensors.tensor(&format!("case-{number:02}")).unwrap();
        let expected = expected.data().chunks_exact(2);
        let expected =
            expected.map(|two| f32::from(u16::from_le_bytes([two[0], two[1]])) / 65535.0);
        let pairs = ours.values.iter().zip(expected);
        let distances: Vec<f32> = pairs.map(|(ours, theirs)| (ours - theirs).abs()).collect();
        assert_eq!(distances.len(), 3 * height * width);
        // The file holds 16 bits of each number.
        let apart = distances.iter().filter(|distance| **distance > 2e-5);
        let (apart, most) = (apart.count(), distances.iter().copied().fold(0.0, f32::max));
        println!("{case:?}: {apart} values differ, by {most} at most");
        // Half way between two pixels, the last bit of a sum decides which one is nearest.
        let affine = case.iter().any(|(name, _)| name == "affine");
        let allowed = if affine { distances.len() / 200 } else { 0 };
        assert!(
            apart <= allowed,
            "{case:?}: {apart} values differ, by {most} at most"
        );
        assert!(before != ours, "{case:?}");
    }
    assert_eq!(changed.len(), 6);
}

#[test]
fn parameters_that_stand_for_nothing_change_nothing() {
    let values = (0..3 * 5 * 7)
        .map(|i| (i * 37 % 256) as u8)
        .collect::<Vec<_>>();
    let before = Picture::of_bytes(5, 7, &values);
    let still = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0];
    let of = |name, values: &[f64]| {
        let mut after = before.clone();
        transform(name, values).apply(&mut after);
        let pairs = after.values.iter().zip(&before.values);
        pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    };
    for name in ["brightness", "contrast", "saturation", "sharpness"] {
        assert!(of(name, &[1.0]) < 1e-6, "{name}");
    }
    assert!(of("hue", &[0.0]) < 1e-6);
    assert_eq!(of("affine", &still), 0.0);
    // A picture without an inside has nothing to sharpen.
    let mut thin = Picture::of_bytes(2, 7, &values[..42]);
    let as_before = thin.clone();
    Transform::Sharpness(0.0).apply(&mut thin);
    assert_eq!(thin, as_before);
}

/// LeRobot 0.4's `ImageTransformsConfig()`, as its `train_config.json` holds it.
fn lerobots_defaults() -> Value {
    let one = |kind: &str, kwargs: Value| json!({"weight": 1.0, "type": kind, "kwargs": kwargs});
    json!({
        "enable": false, "max_num_transforms": 3, "random_order": false,
        "tfs": {
            "brightness": one("ColorJitter", json!({"brightness": [0.8, 1.2]})),
            "contrast": one("ColorJitter", json!({"contrast": [0.8, 1.2]})),
            "saturation": one("ColorJitter", json!({"saturation": [0.5, 1.5]})),
            "hue": one("ColorJitter", json!({"hue": [-0.05, 0.05]})),
            "sharpness": one("SharpnessJitter", json!({"sharpness": [0.5, 1.5]})),
            "affine": one("RandomAffine", json!({"degrees": [-5.0, 5.0], "translate": [0.05, 0.05]})),
        }
    })
}

#[test]
fn the_configuration_is_lerobots() {
    let ours = ImageTransformsConfig::default();
    assert_eq!(serde_json::to_value(&ours).unwrap(), lerobots_defaults());
    let names: Vec<_> = ours.tfs.0.iter().map(|(name, _)| name.as_str()).collect();
    let order = [
        "brightness",
        "contrast",
        "saturation",
        "hue",
        "sharpness",
        "affine",
    ];
    assert_eq!(names, order);
    let read: ImageTransformsConfig = serde_json::from_str(r#"{"enable": true}"#).unwrap();
    assert_eq!(
        read,
        ImageTransformsConfig {
            enable: true,
            ..ours
        }
    );
    assert_eq!(ImageTransformsConfig::default().sampler().unwrap(), None);

    // The order of the file counts.
    let text = r#"{"enable": true, "tfs": {"z": {}, "a": {"type": "RandomAffine", "kwargs":
        {"degrees": 10, "scale": [0.9, 1.1], "shear": [-1, 1, -2, 2]}}, "never": {"weight": 0}}}"#;
    let read: ImageTransformsConfig = serde_json::from_str(text).unwrap();
    assert_eq!(read.tfs.0[0].0, "z");
    assert_eq!(read.sampler().unwrap().unwrap().choices.len(), 2);

    let wrong = |text: &str| -> String {
        let read: Result<ImageTransformsConfig, _> = serde_json::from_str(text);
        match read {
            Ok(read) => match read.sampler().unwrap_err() {
                PolicyError::Options(why) => why,
                other => panic!("{other}"),
            },
            Err(error) => error.to_string(),
        }
    };
    let one = |kind: &str, kwargs: &str| {
        wrong(&format!(
            r#"{{"enable": true, "tfs": {{"mine": {{"type": "{kind}", "kwargs": {kwargs}}}}}}}"#
        ))
    };
    assert!(wrong(r#"{"max_num_transforms": 0}"#).contains("`max_num_transforms` is 0"));
    assert!(wrong(r#"{"enabled": true}"#).contains("enabled"));
    assert!(one("GaussianBlur", "{}").contains("`mine`: no type is called `GaussianBlur`"));
    assert!(one("ColorJitter", r#"{"brightness": [1.2, 0.8]}"#).contains("from 1.2 to 0.8"));
    assert!(one("ColorJitter", r#"{"hue": 0.6}"#).contains("within -0.5 to 0.5"));
    assert!(one("ColorJitter", r#"{"gamma": 1}"#).contains("no parameter `gamma`"));
    assert!(one("SharpnessJitter", "{}").contains("`sharpness` is missing"));
    assert!(
        one("RandomAffine", r#"{"degrees": 5, "translate": [0.1, 2]}"#).contains("`translate`")
    );
    assert!(one("RandomAffine", r#"{"degrees": "5"}"#).contains("`degrees` is \"5\""));
    assert!(one(
        "RandomAffine",
        r#"{"degrees": 5, "interpolation": "bilinear"}"#
    )
    .contains("`interpolation`"));
}

#[test]
fn draws_keep_their_bounds_and_choose_by_weight() {
    let mut config = ImageTransformsConfig {
        enable: true,
        ..ImageTransformsConfig::default()
    };
    config.tfs.0[0].1.weight = 3.0;
    let sampler = config.sampler().unwrap().unwrap();
    let mut rng = ChaCha20Rng::seed_from_u64(1);
    let (mut brightness, mut hue, total) = (0, 0, 4000);
    let place = |transform: &Transform| match transform {
        Transform::Brightness(factor) => (0, (0.8..=1.2).contains(factor)),
        Transform::Contrast(factor) => (1, (0.8..=1.2).contains(factor)),
        Transform::Saturation(factor) => (2, (0.5..=1.5).contains(factor)),
        Transform::Hue(turn) => (3, (-0.05..=0.05).contains(turn)),
        Transform::Sharpness(factor) => (4, (0.5..=1.5).contains(factor)),
        // A twentieth of 64 and of 48 pixels, rounded.
        Transform::Affine(affine) => (5, {
            let [x, y] = affine.translate.map(f64::abs);
            affine.angle.abs() <= 5.0 && x <= 3.0 && y <= 2.0 && x.fract() + y.fract() == 0.0
        }),
    };
    for _ in 0..total {
        let drawn = sampler.draw((48, 64), &mut rng);
        let places: Vec<_> = drawn.iter().map(place).collect();
        assert!(places.iter().all(|(_, within)| *within), "{drawn:?}");
        assert!(
            places.len() == 3 && places.is_sorted_by(|a, b| a.0 < b.0),
            "{drawn:?}"
        );
        brightness += usize::from(places[0].0 == 0);
        hue += usize::from(places.iter().any(|(place, _)| *place == 3));
    }
    // Three draws without replacement, with weights 3, 1, 1, 1, 1, 1.
    let without = (5.0 / 8.0) * (4.0 / 7.0) * (3.0 / 6.0);
    let share = |count: usize| count as f64 / f64::from(total);
    assert!(
        (share(brightness) - (1.0 - without)).abs() < 0.03,
        "{}",
        share(brightness)
    );
    assert!(
        (share(hue) - (3.0 - (1.0 - without)) / 5.0).abs() < 0.03,
        "{}",
        share(hue)
    );

    config.random_order = true;
    let sampler = config.sampler().unwrap().unwrap();
    let mixed = (0..100).any(|_| {
        let drawn = sampler.draw((48, 64), &mut rng);
        !drawn.is_sorted_by_key(|transform| place(transform).0)
    });
    assert!(mixed);
}

/// Variants have names and samples of their own, and come from the cache as other samples do. The frames themselves stay as they are.
#[test]
fn variants_follow_from_the_seed_and_are_cached() {
    let policy = init_policy(&Profile::Micro.config(), 1).unwrap();
    let tokenizer = WordHash::new(&policy.config);
    let datasets = [Dataset::open(fixtures().join("datasets/so100_sorting")).unwrap()];
    let space = KeySpace::new::<PreparedSample>(&policy, &FrozenPlace::default());
    let mut names = FrameNames::new(space, &policy.config, &tokenizer, None);
    let frames = names.frames(0, &datasets[0], &[0, 7, 20]).unwrap();
    let on = ImageTransformsConfig {
        enable: true,
        ..ImageTransformsConfig::default()
    };
    let variants = |config: &ImageTransformsConfig, count, seed| {
        Variants::new(config, count, seed).unwrap().unwrap()
    };
    let named = variants(&on, 4, 1).frames(&frames);
    assert_eq!(named.len(), 12);
    assert!(named.iter().all(|frame| frame.transformed));
    let keys = |frames: &[FrameRef]| -> HashSet<_> { frames.iter().map(|f| f.key).collect() };
    assert_eq!(keys(&[&named[..], &frames[..]].concat()).len(), 15);
    // Fewer variants are a part of more; another seed or other transforms are others.
    assert!(keys(&variants(&on, 2, 1).frames(&frames)).is_subset(&keys(&named)));
    let gentle = ImageTransformsConfig {
        max_num_transforms: 1,
        ..on.clone()
    };
    for others in [variants(&on, 4, 2), variants(&gentle, 4, 1)] {
        assert!(keys(&others.frames(&frames)).is_disjoint(&keys(&named)));
    }
    assert!(Variants::new(&on, 0, 1).is_err() && Variants::new(&on, 1001, 1).is_err());
    assert!(Variants::new(&ImageTransformsConfig::default(), 4, 1)
        .unwrap()
        .is_none());

    let dir = tempfile::tempdir().unwrap();
    let cache = DiskCache::open(dir.path(), 1 << 30).unwrap();
    let maker = |variants| {
        let maker = FrameMaker::new(&datasets, policy.config.chunk_size, || {
            Preparer::new(&policy, &tokenizer)
        });
        maker.with_variants(variants)
    };
    let samples = |cache: Option<&DiskCache>, maker: &FrameMaker, frames: &[FrameRef]| {
        let source = FrameSource::<PreparedSample>::new(cache, maker, frames.to_vec());
        let all = (0..frames.len()).map(|i| source.sample(i).unwrap().into_owned());
        all.collect::<Vec<_>>()
    };
    let (plain, transforming) = (maker(None), maker(Some(variants(&on, 4, 1))));
    let transformed = samples(Some(&cache), &transforming, &named);
    assert!(
        transformed == samples(Some(&cache), &transforming, &named),
        "from the cache"
    );
    assert!(
        transformed == samples(None, &transforming, &named),
        "computed again"
    );
    let as_recorded = samples(None, &plain, &frames);
    assert!(
        as_recorded == samples(None, &transforming, &frames),
        "a frame is not transformed"
    );
    for (place, sample) in transformed.iter().enumerate() {
        let original = &as_recorded[place / 4];
        assert!(sample.keys != original.keys, "{place}");
        assert_eq!(
            (&sample.actions, &sample.is_pad),
            (&original.actions, &original.is_pad)
        );
    }
    // Without transforms, a variant is an error and not the frame as it is.
    let source = FrameSource::<PreparedSample>::new(None, &plain, named);
    let error = source.sample(0).unwrap_err().to_string();
    assert!(
        error.contains("nothing states how to transform it"),
        "{error}"
    );
}
