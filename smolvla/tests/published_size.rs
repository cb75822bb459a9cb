//! The published dimensions, with random weights: names, a forward pass, and the memory it takes.
//!
//! The peak is that of the process.

use candle_core::{Device, Tensor};
use zk0_lerobot::layout::state_dict_layout;
use zk0_smolvla::policy::init::init_policy;
use zk0_smolvla::policy::model::expert::ExpertModel;
use zk0_smolvla::policy::model::prefix::{CameraInput, PrefixInput, PrefixModel};
use zk0_smolvla::policy::model::PolicyParameters;
use zk0_smolvla::policy::profile::Profile;
use zk0_testkit::own_process::alone;

use crate::reference::{peak_gib, published_parameters};

/// The weights that a forward pass uses are 1.5 GiB in F32. PyTorch takes 3.9 GB for a training step of the same.
const MOST_GIB: f64 = 2.1;

/// Deterministic noise of unit size.
fn noise(shape: &[usize]) -> Tensor {
    let elements: usize = shape.iter().product();
    let values = (0..elements).map(|i| ((i as f64 * 12.9898).sin() * 43758.5453).fract() as f32);
    Tensor::from_iter(values, &Device::Cpu)
        .unwrap()
        .reshape(shape)
        .unwrap()
}

#[test]
fn a_forward_pass_at_the_published_size_in_bounded_memory() {
    let test = "published_size::a_forward_pass_at_the_published_size_in_bounded_memory";
    if !alone(test, &[]) {
        return;
    }
    let config = Profile::Full.config();
    let policy = init_policy(&config, 7).unwrap();
    let mut all = policy.frozen;
    all.extend(policy.expert.into_tensors());

    // The loop counts the tensors that the state dict has and that the policy uses.
    let mut found = 0;
    let (mut tensors, mut parameters) = (0, 0);
    let json = published_parameters();
    let layout = state_dict_layout(&config);
    for parameter in json["parameters"].as_array().unwrap() {
        let name = parameter["name"].as_str().unwrap();
        let shape: Vec<usize> = serde_json::from_value(parameter["shape"].clone()).unwrap();
        assert_eq!(layout[name], shape, "{name}");
        tensors += 1;
        parameters += shape.iter().product::<usize>();
        if let Some(tensor) = all.get(name) {
            assert_eq!(tensor.shape, shape, "{name}");
            assert_eq!(tensor.data.len(), shape.iter().product::<usize>(), "{name}");
            found += 1;
        }
    }
    assert_eq!((tensors, parameters), (500, 450_046_176));
    // The policy uses all tensors but the language model's head.
    assert_eq!((found, all.len()), (499, 499));

    let device = &Device::Cpu;
    let parameters = PolicyParameters::take(all, device).unwrap();
    let prefix = PrefixModel::new(&config, &parameters).unwrap();
    let expert = ExpertModel::new(&config, &parameters).unwrap();
    let size = config.vision.image_size;
    let camera = || CameraInput {
        pixels: noise(&[1, 3, size, size]),
        present: vec![true],
    };
    let tokens: Vec<u32> = (0..config.max_language_tokens as u32)
        .map(|i| i * 1000)
        .collect();
    let count = tokens.len();
    let cache = prefix
        .cache(&PrefixInput {
            cameras: (0..config.cameras).map(|_| camera()).collect(),
            tokens: Tensor::from_vec(tokens, (1, count), device).unwrap(),
            token_mask: vec![vec![true; count]],
            state: noise(&[1, config.max_state_dim]),
        })
        .unwrap();
    assert_eq!(cache.keys.len(), config.text.layers);
    let kv = [
        1,
        config.max_prefix_tokens(),
        config.text.kv_heads,
        config.text.head_dim,
    ];
    assert_eq!(cache.keys[0].dims(), kv);
    let shape = [1, config.chunk_size, config.max_action_dim];
    let v_t = expert.forward(&cache, &noise(&shape), &[0.5]).unwrap();
    assert_eq!(v_t.dims(), shape);
    let v_t: Vec<f32> = v_t.flatten_all().unwrap().to_vec1().unwrap();
    assert!(v_t.iter().all(|v| v.is_finite()));
    assert!(v_t.iter().any(|v| v.abs() > 1e-6));

    let peak = peak_gib();
    println!("peak memory {peak:.2} GiB (at most {MOST_GIB})");
    assert!(peak <= MOST_GIB, "{peak:.2} GiB");
}
