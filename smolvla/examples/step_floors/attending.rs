//! Measures attention, rotary embeddings, and the keys and values that are joined for attention.

use candle_core::{Device, Tensor};
use zk0_lerobot::config::{LayerKind, PolicyConfig};
use zk0_smolvla::policy::model::attention::{attend, Mask};
use zk0_smolvla::policy::model::kernels::attention::attend_to_all;
use zk0_smolvla::policy::model::rope::Rope;
use zk0_smolvla::policy::model::visibility::action_sees;

use crate::report::{run, tensor, variable, Least, Report};
use crate::Failure;

/// Of an attention with so many queries and keys a sample: both products, and what goes in and comes out once. Scores need never
/// leave the cache.
fn least_of(c: &PolicyConfig, batch: usize, queries: usize, keys: usize) -> Least {
    Least {
        operations: 4.0 * (batch * queries * keys * c.query_width()) as f64,
        numbers: (batch * (2 * queries * c.query_width() + 2 * keys * c.kv_width())) as f64,
    }
}

pub fn attention(report: &mut Report, c: &PolicyConfig, batch: usize) -> Result<(), Failure> {
    let (patches, width) = (c.patches(), c.vision.width);
    let x = tensor(&[batch, patches, 3 * width])?;
    let least = Least {
        operations: 4.0 * (batch * patches * patches * width) as f64,
        numbers: (4 * batch * patches * width) as f64,
    };
    let calls = c.cameras * c.vision.layers;
    report.kernel("vision: attention", calls, least, || {
        run(attend_to_all(&x, c.vision.heads))
    });

    let (prefix, chunk) = (c.max_prefix_tokens(), c.chunk_size);
    let (heads, kv_heads, dim) = (c.text.heads, c.text.kv_heads, c.text.head_dim);
    let mask = Mask::new((batch, prefix, prefix), &Device::Cpu, |_, _, _| true)?;
    let (q, k) = (
        tensor(&[batch, prefix, heads, dim])?,
        tensor(&[batch, prefix, kv_heads, dim])?,
    );
    let layers = c.text.layers;
    report.kernel(
        "text: attention",
        layers - 1,
        least_of(c, batch, prefix, prefix),
        || run(attend(&q, &k, &k, &mask)),
    );

    let kind = |wanted: LayerKind| (0..layers).filter(|i| c.layer_kind(*i) == wanted).count();
    let (joint, cross) = (kind(LayerKind::Joint), kind(LayerKind::Cross));
    for (name, calls, queries, keys) in [
        ("state token: attention", layers - 1, 1, prefix),
        ("expert: attention, joint", joint, chunk, prefix + chunk),
        ("expert: attention, cross", cross, chunk, prefix),
    ] {
        let valid = vec![true; prefix];
        let mask = Mask::new((batch, queries, keys), &Device::Cpu, |_, q, k| {
            action_sees(&valid, q, k)
        })?;
        let (q, k, v) = (
            variable(&[batch, queries, heads, dim])?,
            variable(&[batch, keys, kv_heads, dim])?,
            variable(&[batch, keys, kv_heads, dim])?,
        );
        let least = least_of(c, batch, queries, keys);
        let work = || Ok(attend(&q, &k, &v, &mask)?);
        report.trained(name, calls, (least, least.times(2.0)), work)?;
    }
    rotations(report, c, batch)?;

    // The keys and values that a layer of the expert or of the state's token attends to come from two places, and are joined.
    for (name, layers, own) in [
        ("expert: joining keys or values", joint, chunk),
        ("state token: joining keys or values", layers, 1),
    ] {
        let (seen, new) = (
            variable(&[batch, prefix, kv_heads, dim])?,
            variable(&[batch, own, kv_heads, dim])?,
        );
        let least = Least::moving(2 * batch * (prefix + own) * c.kv_width());
        let work = || Ok(Tensor::cat(&[&seen, &new], 1)?);
        report.trained(name, 2 * layers, (least, least), work)?;
    }
    Ok(())
}

fn rotations(report: &mut Report, c: &PolicyConfig, batch: usize) -> Result<(), Failure> {
    let (prefix, chunk, dim) = (c.max_prefix_tokens(), c.chunk_size, c.text.head_dim);
    let layers = c.text.layers;
    let rope = |tokens: usize| {
        let positions: Vec<i64> = (0..tokens as i64).collect();
        Rope::new(&vec![positions; batch], dim, &Device::Cpu)
    };
    let moving = |tokens: usize, heads: usize| Least::moving(2 * batch * tokens * heads * dim);
    for (what, calls, heads) in [
        ("queries", layers - 1, c.text.heads),
        ("keys", layers, c.text.kv_heads),
    ] {
        let (rope, x) = (rope(prefix)?, tensor(&[batch, prefix, heads, dim])?);
        let name = format!("text: rotating {what}");
        report.kernel(&name, calls, moving(prefix, heads), || run(rope.apply(&x)));
    }
    let joint = (0..layers).filter(|i| c.layer_kind(*i) == LayerKind::Joint);
    for (what, calls, heads) in [
        ("queries", layers, c.text.heads),
        ("keys", joint.count(), c.text.kv_heads),
    ] {
        let (rope, x) = (rope(chunk)?, variable(&[batch, chunk, heads, dim])?);
        let least = moving(chunk, heads);
        let name = format!("expert: rotating {what}");
        report.trained(&name, calls, (least, least), || Ok(rope.apply(&x)?))?;
    }
    Ok(())
}
