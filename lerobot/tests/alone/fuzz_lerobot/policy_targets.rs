//! The files of a policy folder.

use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;

use zk0_lerobot::layout::policy_layout;
use zk0_lerobot::policy_folder::{LeRobotConfig, PolicyFolder};

use zk0_lerobot::{PolicyConfig, StoredTensors};
use zk0_tensors::{write_to, TensorEntry};
use zk0_testkit::fuzzing::Target;
use zk0_testkit::recordings::fixtures;

fn tiny(file: &str) -> PathBuf {
    fixtures().join("smolvla_tiny").join(file)
}

/// The dimensions of the fixture.
pub fn config() -> PolicyConfig {
    let text = |file: &str| fs::read_to_string(tiny(file)).unwrap();
    let (policy, vlm) = (text("policy_config.json"), text("vlm_config.json"));
    LeRobotConfig::parse(&policy, Some(&vlm)).unwrap().dims
}

/// Reads the tensors of a file one by one.
pub fn tensor_file() -> Target {
    let dir = tempfile::tempdir().unwrap();
    let entry = |name: &str, shape: &[usize]| TensorEntry {
        name: name.into(),
        shape: shape.into(),
        values: vec![0.5; shape.iter().product()].into(),
    };
    let entries = vec![
        entry("model.a.weight", &[12, 8]),
        entry("model.a.bias", &[12]),
    ];
    let mut seed = Vec::new();
    write_to(&mut seed, entries, BTreeMap::new()).unwrap();
    Target {
        seeds: vec![seed],
        run: Box::new(move |bytes| {
            let path = dir.path().join("input");
            fs::write(&path, bytes).unwrap();
            let read = StoredTensors::open(&path).and_then(|file| {
                let names = file.names();
                names.iter().try_for_each(|name| file.read(name).map(drop))
            });
            read.map_err(|e| e.to_string().replace(path.to_str().unwrap(), ""))
        }),
    }
}

/// Reads the configuration of a policy, and with it the tensors that it asks for.
pub fn policy_json() -> Target {
    let vlm = fs::read_to_string(tiny("vlm_config.json")).unwrap();
    Target {
        seeds: vec![fs::read(tiny("policy_config.json")).unwrap()],
        run: Box::new(move |bytes| parse(&String::from_utf8_lossy(bytes), &vlm)),
    }
}

pub fn vlm_json() -> Target {
    let policy = fs::read_to_string(tiny("policy_config.json")).unwrap();
    Target {
        seeds: vec![fs::read(tiny("vlm_config.json")).unwrap()],
        run: Box::new(move |bytes| parse(&policy, &String::from_utf8_lossy(bytes))),
    }
}

fn parse(policy: &str, vlm: &str) -> Result<(), String> {
    let config = LeRobotConfig::parse(policy, Some(vlm)).map_err(|e| unquoted(&e.to_string()))?;
    drop(policy_layout(&config.dims));
    Ok(())
}

/// Cuts the message before the text that it quotes from a file, because that text may hold quotation marks.
fn unquoted(message: &str) -> String {
    let ends = [" is `", " by `"].iter().filter_map(|q| message.find(q));
    message[..ends.min().unwrap_or(message.len())].to_owned()
}

/// Reads all steps of a folder's processors, and the statistics that they lead to.
pub fn processor_json() -> Target {
    let dir = tempfile::tempdir().unwrap();
    let to = |name: &str| dir.path().join(name);
    for (from, name) in [
        ("policy_config.json", "config.json"),
        ("vlm_config.json", "vlm_config.json"),
        ("weights.safetensors", "model.safetensors"),
    ] {
        fs::copy(tiny(from), to(name)).unwrap();
    }
    let numbers: Vec<u8> = [1.0f32; 6].iter().flat_map(|x| x.to_le_bytes()).collect();
    let names = ["observation.state", "action"]
        .map(|name| ["mean", "std"].map(|what| format!("{name}.{what}")));
    let views = names.as_flattened().iter().map(|name| {
        use safetensors::tensor::{Dtype, TensorView};
        let view = TensorView::new(Dtype::F32, vec![6], &numbers).unwrap();
        (name, view)
    });
    let state = safetensors::serialize(views, None).unwrap();
    fs::write(to("state.safetensors"), state).unwrap();
    let seed = |kind: &str| {
        format!(
            r#"{{"name": "x", "steps": [{{"registry_name": "device_processor", "config": {{}}}},
            {{"registry_name": "{kind}", "config": {{"eps": 1e-08}}, "state_file": "state.safetensors"}}]}}"#
        )
    };
    let post = seed("unnormalizer_processor");
    fs::write(to("policy_postprocessor.json"), post).unwrap();
    // All steps that LeRobot 0.6.1 writes.
    let made = fixtures().join("policy_processors/map_in_order/policy_preprocessor.json");
    let made = fs::read_to_string(made).unwrap();
    let made = made.replace(
        "policy_preprocessor_step_5_normalizer_processor.safetensors",
        "state.safetensors",
    );
    Target {
        seeds: vec![seed("normalizer_processor").into_bytes(), made.into_bytes()],
        run: Box::new(move |bytes| {
            fs::write(dir.path().join("policy_preprocessor.json"), bytes).unwrap();
            match PolicyFolder::open(dir.path()).and_then(|folder| folder.stats()) {
                Ok(Some(_)) => Ok(()),
                Ok(None) => Err("no statistics".into()),
                Err(e) => {
                    let reported = unquoted(&e.to_string());
                    let own = dir.path().join("policy_preprocessor.json: ");
                    match reported.strip_prefix(own.to_str().unwrap()) {
                        Some(why) => Err(why.to_owned()),
                        // The input chooses the name of this file.
                        None => Err("another file".into()),
                    }
                }
            }
        }),
    }
}
