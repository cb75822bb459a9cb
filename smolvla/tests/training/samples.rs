//! What a sample holds, and which observations are refused.

use zk0_smolvla::PolicyError;

use super::scene::Scene;

#[test]
fn a_sample_has_the_profiles_shapes_and_only_real_tokens() {
    let sample = Scene::at(0).prepare().unwrap();
    assert_eq!(sample.prefix_tokens, 2 * 4 + 3 + 1);
    assert_eq!(Scene::at(1).prepare().unwrap().prefix_tokens, 2 * 4 + 1 + 1);
    assert_eq!((sample.keys.len(), sample.values.len()), (2, 2));
    assert!(sample
        .keys
        .iter()
        .chain(&sample.values)
        .all(|layer| layer.len() == 12 * 8));
    assert!(sample
        .actions
        .chunks(8)
        .all(|frame| frame[6..] == [0.0, 0.0] && frame[0] != 0.0));
    let values: Vec<f32> = sample
        .keys
        .iter()
        .chain(&sample.values)
        .flatten()
        .copied()
        .collect();
    let size = (values.iter().map(|x| x * x).sum::<f32>() / values.len() as f32).sqrt();
    assert!(
        (0.2..5.0).contains(&size),
        "keys and values of about unit size, not {size}"
    );
}

#[test]
fn every_part_of_the_observation_reaches_the_cache() {
    let plain = Scene::at(0).prepare().unwrap();
    let changed = |change: fn(&mut Scene)| {
        let mut scene = Scene::at(0);
        change(&mut scene);
        let sample = scene.prepare().unwrap();
        sample.keys[1] != plain.keys[1] && sample.values[1] != plain.values[1]
    };
    assert!(changed(|s| s.pictures[0].3[500] ^= 128));
    assert!(changed(|s| s.pictures[1].3[500] ^= 128));
    assert!(changed(|s| s.state[5] += 0.5));
    assert!(changed(|s| s.task = "follow the light"));
    assert!(
        !changed(|s| s.pictures.reverse()),
        "cameras fill the slots in name order"
    );
    assert!(!changed(|s| s.task = "Follow the spot!"));
}

#[test]
fn observations_that_do_not_fit_are_refused() {
    let refusal = |change: fn(&mut Scene)| {
        let mut scene = Scene::at(0);
        change(&mut scene);
        match scene.prepare() {
            Err(PolicyError::Sample(what)) => what,
            other => panic!("{other:?}"),
        }
    };
    assert!(refusal(|s| s.pictures.clear()).contains("0 cameras"));
    assert!(refusal(|s| s.pictures.push(("extra", 1, 1, vec![0; 3]))).contains("3 cameras"));
    assert!(refusal(|s| s.pictures[1].1 = 41).contains("`wrist`"));
    assert!(refusal(|s| s.pictures[1].1 = usize::MAX).contains("`wrist`"));
    assert!(refusal(|s| (s.pictures[1].1, s.pictures[1].3) = (0, vec![])).contains("`wrist`"));
    assert!(refusal(|s| s.state.push(0.0)).contains("7 dimensions"));
    assert!(refusal(|s| s.state[2] = f32::NAN).contains("state value 2 is NaN"));
    assert!(refusal(|s| s.actions[3] = f32::INFINITY).contains("action value 3 is inf"));
    assert!(refusal(|s| s.actions.truncate(35)).contains("35 action values"));
    assert!(refusal(|s| s.is_pad.push(true)).contains("7 padding flags"));
}
