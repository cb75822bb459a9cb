//! What the challenge draws for each evaluated sample: its flow time and its noise.
//!
//! Flow times are stratified: the distribution is cut into as many equal parts as there are samples, and each sample's time comes from
//! a part of its own. Times that cover the distribution evenly vary less in their mean, so that a test of the losses needs fewer
//! samples. Where in its part a time lies stays unpredictable.

use crate::model::arithmetic::fixed::Rescale;
use crate::model::arithmetic::tables::{flow_time, gaussian, FLOW_TIME_BITS, GAUSS_BITS};
use crate::model::spec::EvalSpec;
use crate::vm::digest::{tagged_sha256, Digest};
use crate::vm::poseidon2::{Domain, Stream};
use alloc::vec;
use alloc::vec::Vec;

/// Flow time and noise of one evaluated sample.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Draw {
    /// Flow time in units of 2^-16, as LeRobot trains: 0.999 · Beta(1.5, 1) + 0.001.
    pub time: u16,
    /// Standard normal noise `[chunk, max_action_dim]` with [`EvalSpec::action`] fraction bits.
    pub noise: Vec<i16>,
}

/// The flow time of `position`: `word` states where it lies in part `position` of `count` equal parts of the distribution.
fn stratified(position: u32, count: u32, word: u16) -> u16 {
    let place = (u64::from(position) << 16) | u64::from(word);
    let share = place / u64::from(count.max(1)); // of 2^16: the probability of a smaller time
    flow_time((share >> (16 - FLOW_TIME_BITS)) as u16)
}

/// Draws for the evaluated sample at `position` (0, 1, … in the order of [`crate::claim::challenge::sample_indices`]) of `count`.
///
/// The first two bytes of `H("zk0/draw/v4", challenge, position)`, a little-endian u16, state where the flow time lies in its part of the
/// distribution. The noise is made of the stream ([`Stream`]) that this digest seeds, 12 bits for each value.
pub fn draw(spec: &EvalSpec, challenge: &Digest, position: u32, count: u32) -> Draw {
    let values = spec.dims.chunk as usize * spec.dims.max_action_dim as usize;
    let seed = tagged_sha256("zk0/draw/v4", &[&challenge.0, &position.to_le_bytes()]);
    let scale = Rescale::new(GAUSS_BITS as i32, spec.action as i32);
    let mut stream = Stream::new(Domain::Draw, &seed);
    let mut noise = vec![0; values];
    for values in noise.chunks_mut(16) {
        for (value, uniform) in values.iter_mut().zip(stream.draw()) {
            // Below 2^14, and the scale has at most 12 bits
            *value = scale.apply(gaussian(uniform) as i64) as i16;
        }
    }
    Draw {
        time: stratified(position, count, u16::from_le_bytes([seed.0[0], seed.0[1]])),
        noise,
    }
}
