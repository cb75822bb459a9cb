//! The whole expert, from what its parts cost: an estimate, with its inputs in its output.
//!
//! Counted are the committed field elements of one sample and model, by the steps of `circuits/src/eval.rs`, and the
//! sumchecks, claims and queries of a verifier for any number of samples: rows of all samples are one matrix, so that
//! their number only adds variables.

use std::fmt::Write;

/// Action tokens, prefix tokens.
const TOKENS: [usize; 2] = [50, 177];
const WIDTH: usize = 720;
const MLP: usize = 2048;
const QUERY: usize = 960;
const KEY: usize = 320;
const HEADS: usize = 15;
/// Layers that attend to the action tokens too, and those that do not.
const LAYERS: [usize; 2] = [8, 8];
/// Product sumchecks per layer: seven matrices, scores, weighted values.
const PRODUCTS_PER_LAYER: usize = 9;
/// The same outside the layers: action in, time MLP in and out, action out.
const OTHER_PRODUCTS: usize = 4;
/// Kinds of elementwise steps, each one zero-check over all layers and samples: noised action, SiLU of the time MLP,
/// squares and divisions of the norms, two halves of the rotations, largest score, distances, sums and divisions of the
/// softmax, gated product, squared error.
const ELEMENTWISE: usize = 12;

/// What a step commits per value: the value, and remainders in limbs of at most 16 bits.
const NARROWED: usize = 2;
/// Quotient, and a remainder below a denominator of up to 56 bits: four limbs.
const DIVIDED: usize = 5;
/// Narrowed distance, three limbs of remainder, weight.
const SOFTMAX: usize = 5;

/// Committed elements of one sample and model: of the layers, the rest is below a hundredth of it.
pub fn committed_elements() -> usize {
    let [tokens, prefix] = TOKENS;
    let layer = |own: bool| {
        let keys = 2 * KEY * if own { tokens } else { prefix };
        let rotated = tokens * (QUERY + if own { KEY } else { 0 });
        let scores = HEADS * tokens * if own { prefix + tokens } else { prefix };
        NARROWED * (tokens * QUERY + keys + rotated)
            + SOFTMAX * scores
            + DIVIDED * tokens * (QUERY + 2 * WIDTH)
            + NARROWED * tokens * (2 * WIDTH + 2 * MLP)
            // SiLU's output, and the gated product.
            + (1 + NARROWED) * tokens * MLP
    };
    LAYERS[0] * layer(true) + LAYERS[1] * layer(false)
}

/// Values of the prefix's keys and values in one sample. The guest binds them to the sample's digest by hashing them, as it
/// does today, and evaluates their multilinear extension.
pub const SAMPLE: usize = 2 * (LAYERS[0] + LAYERS[1]) * TOKENS[1] * KEY;
/// Cycles and gas of hashing one value of a sample: a permutation takes twelve (docs of `circuits/src/poseidon2.rs` and
/// the table in the design), packing included. Assumed here, not measured.
const HASHED: f64 = 4.0;

/// Guest cycles and gas by case.
#[derive(Default)]
pub struct Costs(Vec<(String, [f64; 2])>);

impl Costs {
    /// Adds one measurement.
    pub fn add(&mut self, name: &str, cycles: u64, gas: u64) {
        self.0.push((name.into(), [cycles as f64, gas as f64]));
    }

    /// The first case whose name starts and ends so, over that of doing nothing.
    fn get(&self, start: &str, end: &str) -> Result<[f64; 2], String> {
        let find = |start: &str, end: &str| {
            let case = self.0.iter().find(|(name, _)| name.starts_with(start) && name.ends_with(end));
            case.map(|&(_, cost)| cost).ok_or(format!("no case '{start}…{end}' was measured"))
        };
        let (cost, nothing) = (find(start, end)?, find("nothing", "")?);
        Ok([cost[0] - nothing[0], cost[1] - nothing[1]])
    }
}

/// One JSON line: the verifier's cost for `samples` samples under both models.
pub fn estimate(costs: &Costs, samples: usize) -> Result<String, String> {
    let models = 2;
    let elements = committed_elements() * models * samples;
    let variables = elements.next_power_of_two().trailing_zeros() as usize;
    let products = models * (LAYERS.iter().sum::<usize>() * PRODUCTS_PER_LAYER + OTHER_PRODUCTS);
    let matmul = costs.get("matmul", "")?;

    // Look-ups: measured at two sizes; the rounds of the tree grow with the square of its height.
    let lookups: Vec<(usize, [f64; 2])> = (17..24)
        .filter_map(|bits| Some((bits, costs.get(&format!("look-ups 2·2^{bits}"), "").ok()?)))
        .collect();
    let [(small, small_cost), .., (large, large_cost)] = lookups[..] else {
        return Err("look-ups were not measured at two sizes".into());
    };
    let rounds = |lookups: usize| {
        let leaves = lookups + 2;
        (leaves * (leaves - 1) / 2) as f64
    };

    // Openings: measured for one claim, and for 128 points of one and of four.
    let one = costs.get("opening 2^", "64 columns, rate 1/4")?;
    let (points, blocks) = (costs.get("opening", "128 points of 1 claims")?, costs.get("opening", "128 points of 4 claims")?);
    let columns = (costs.get("opening 2^", "64 columns, rate 1/4")?, costs.get("opening 2^", "128 columns, rate 1/4")?);
    let opened = one_size(costs)?;
    // Two points per product (input; output with its remainder), four per kind of elementwise step.
    let (claim_points, claims) = (2 * products + 4 * ELEMENTWISE, 3 * products + 12 * ELEMENTWISE);
    let more_columns = 64.0 * ((1u64 << variables.saturating_sub(opened)) as f64 - 1.0);

    let table = costs.get("table", "")?;
    let parts: [(&str, [f64; 2]); 6] = core::array::from_fn(|part| {
        let cost = core::array::from_fn(|unit| {
            let round = (large_cost[unit] - small_cost[unit]) / (rounds(large) - rounds(small));
            let per_point = (points[unit] - one[unit]) / 127.0;
            let per_claim = (blocks[unit] - points[unit]) / 384.0;
            match part {
                0 => products as f64 * matmul[unit],
                1 => large_cost[unit] + round * (rounds(variables - 1) - rounds(large)),
                // Degree 3: half as much again per round as measured for degree 2 with its factor left out.
                2 => (ELEMENTWISE * variables) as f64 * 1.5 * round,
                3 => claim_points as f64 * per_point + (claims - claim_points) as f64 * per_claim,
                4 => one[unit] + more_columns * (columns.1[unit] - columns.0[unit]).max(0.0) / 64.0,
                _ => (samples * SAMPLE) as f64 * (table[unit] / 65536.0 + HASHED),
            }
        });
        (["products", "look-ups", "elementwise", "claims", "opening", "samples"][part], cost)
    });
    let mut line = format!(
        "{{\"estimate\":\"expert\",\"samples\":{samples},\"models\":{models},\"committed_elements\":{elements},\
         \"variables\":{variables},\"product_sumchecks\":{products},\"points\":{claim_points},\"claims\":{claims}"
    );
    for (unit, name) in ["cycles", "gas"].into_iter().enumerate() {
        for (part, cost) in &parts {
            let _ = write!(line, ",\"{part}_{name}\":{:.0}", cost[unit]);
        }
        let total: f64 = parts.iter().map(|(_, cost)| cost[unit]).sum();
        let _ = write!(line, ",\"total_{name}\":{total:.0}");
    }
    line.push('}');
    Ok(line)
}

/// Variables of the opening that was measured with 64 columns.
fn one_size(costs: &Costs) -> Result<usize, String> {
    let name = costs.0.iter().map(|(name, _)| name).find(|name| name.ends_with("64 columns, rate 1/4"));
    let size = name.and_then(|name| name.strip_prefix("opening 2^")?.split(',').next()?.parse().ok());
    size.ok_or_else(|| "no opening with 64 columns was measured".into())
}
