//! The linear maps of a step.

use std::collections::BTreeMap;

use zk0_lerobot::config::PolicyConfig;
use zk0_lerobot::layout::{policy_layout, EXPERT, VLM};
use zk0_smolvla::policy::model::kernels::linear::LinearLayer;

use crate::report::{run, tensor, variable, Least, Report};
use crate::Failure;

/// Where a gradient goes.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Gradient {
    Nothing,
    Input,
    InputAndWeight,
}

/// Linear maps of one size in one part of the policy.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord)]
struct Maps {
    part: &'static str,
    rows: usize,
    inner: usize,
    out: usize,
    gradient: Gradient,
}

/// Returns the linear maps of a step, and how often the step runs each of them.
fn of_a_step(c: &PolicyConfig, batch: usize) -> BTreeMap<Maps, usize> {
    let prefix = batch * c.max_prefix_tokens();
    let suffix = batch * c.chunk_size;
    let last = format!("{VLM}.text_model.layers.{}.", c.text.layers - 1);
    let mut all: BTreeMap<Maps, usize> = BTreeMap::new();
    for (name, mut shape) in policy_layout(c) {
        let vision = name.contains("vision_model");
        let key_or_value = name.contains("k_proj") || name.contains("v_proj");
        if vision && key_or_value {
            // This matrix is part of the product that `q_proj` stands for.
            continue;
        }
        if vision && name.contains("q_proj") {
            shape[0] *= 3;
        }
        if name.starts_with(&last) && !key_or_value {
            // The expert reads only the keys and values of the last language layer.
            continue;
        }
        let (out, inner) = match shape.as_slice() {
            _ if name.contains("embed_tokens") || name.contains("position_embedding") => continue,
            [out, channels, height, width] => (*out, channels * height * width),
            [out, inner] => (*out, *inner),
            _ => continue,
        };
        let maps = |part, rows, gradient| Maps {
            part,
            rows,
            inner,
            out,
            gradient,
        };
        let (map, calls) = if vision {
            let map = maps("vision", batch * c.patches(), Gradient::Nothing);
            (map, c.cameras)
        } else if name.contains("connector") {
            let rows = batch * c.tokens_per_camera();
            (maps("connector", rows, Gradient::Nothing), c.cameras)
        } else if name.starts_with(VLM) {
            // The state's token goes this way once more, because a gradient goes back along it.
            let token = maps("state token", batch, Gradient::Input);
            *all.entry(token).or_default() += 1;
            (maps("text", prefix, Gradient::Nothing), 1)
        } else if name.contains("state_proj") {
            (maps("state", batch, Gradient::InputAndWeight), 1)
        } else if name.starts_with(EXPERT) && key_or_value && inner != c.expert.width {
            let part = "expert, cross keys and values";
            (maps(part, prefix, Gradient::InputAndWeight), 1)
        } else {
            (maps("expert", suffix, Gradient::InputAndWeight), 1)
        };
        *all.entry(map).or_default() += calls;
    }
    all
}

pub fn linear_maps(report: &mut Report, c: &PolicyConfig, batch: usize) -> Result<(), Failure> {
    for (map, calls) in of_a_step(c, batch) {
        let Maps {
            rows, inner, out, ..
        } = map;
        let name = format!("{}: linear {rows} x {inner} -> {out}", map.part);
        let (x, w) = (&[rows, inner], &[out, inner]);
        let least = Least {
            operations: 2.0 * (rows * out * inner) as f64,
            numbers: (rows * (out + inner) + out * inner) as f64,
        };
        if map.gradient == Gradient::Nothing {
            let (x, map) = (tensor(x)?, LinearLayer::new(tensor(w)?, None));
            report.kernel(&name, calls, least, || run(map.forward(&x)));
            continue;
        }
        // The product for a gradient reads one of the matrices and the result's gradient, and writes a matrix of the other's size.
        let (w, back) = match map.gradient {
            Gradient::InputAndWeight => (variable(w)?, least.times(2.0)),
            _ => (tensor(w)?, least),
        };
        let (x, map) = (variable(x)?, LinearLayer::new(w, None));
        report.trained(&name, calls, (least, back), || Ok(map.forward(&x)?))?;
    }
    Ok(())
}
