//! The axes of the expert's tensors, and how many bits the index on each has.

use crate::relation::Axis;
use alloc::vec::Vec;
use zk0_circuits::EvalSpec;

/// Action tokens: the frames of a chunk.
pub const T: Axis = Axis(0);
/// Layers of both models: those of the base, then those of the update.
pub const N: Axis = Axis(1);
/// The width of the residual stream.
pub const F: Axis = Axis(2);
/// Samples.
pub const S: Axis = Axis(3);
/// Query heads.
pub const H: Axis = Axis(4);
/// The width of a head.
pub const D: Axis = Axis(5);
/// What is attended to: first the action tokens, then the tokens of the prefix.
pub const P: Axis = Axis(6);
/// Models: the base, then the update.
pub const M: Axis = Axis(7);
/// Action dimensions.
pub const A: Axis = Axis(8);
/// The width of the MLP.
pub const G: Axis = Axis(9);
/// Self-attention layers of both models.
pub const SN: Axis = Axis(10);
/// Key and value heads.
pub const V: Axis = Axis(11);
/// Cross-attention layers of both models.
pub const CN: Axis = Axis(12);
/// Tokens of the prefix.
pub const PC: Axis = Axis(13);
/// Key and value heads that a product sums over.
pub const V2: Axis = Axis(14);
/// The width of a head that a product sums over.
pub const D2: Axis = Axis(15);
/// The width of the residual stream that a product sums over.
pub const F2: Axis = Axis(16);
/// Layers of one model.
pub const L: Axis = Axis(17);
/// Rows of the table of ranges.
pub const R: Axis = Axis(18);
/// Rows of the table of powers of two.
pub const X: Axis = Axis(19);
/// Rows of a table of gates.
pub const Q: Axis = Axis(20);
/// One model: the half of [`M`].
pub const M1: Axis = Axis(21);
/// Self-attention layers of one model.
pub const SN1: Axis = Axis(22);
/// Cross-attention layers of one model.
pub const CN1: Axis = Axis(23);

/// What the sizes of tensors follow from.
#[derive(Clone, Debug)]
pub struct Sizes {
    /// Bits of each axis.
    pub bits: Vec<u8>,
    /// Layers of one model.
    pub layers: usize,
    /// For each layer its number among those of self-attention, or among those of cross-attention.
    pub kinds: Vec<Kind>,
    /// Values are checked to be in ranges of up to so many bits at once.
    pub limb: u32,
}

/// What a layer attends to, with its number among the layers that do so.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// The prefix and the action tokens up to its own.
    OfItself(usize),
    /// The prefix.
    Cross(usize),
}

/// Bits of an index below `count`.
fn bits(count: usize) -> u8 {
    count.next_power_of_two().trailing_zeros() as u8
}

impl Sizes {
    /// The sizes for a valid specification and a number of samples.
    pub fn new(spec: &EvalSpec, samples: usize) -> Self {
        let dims = &spec.dims;
        let layers = dims.layers as usize;
        let (mut of_itself, mut cross) = (0, 0);
        let kind = |layer: usize| {
            if dims.is_self_attention(layer) {
                of_itself += 1;
                Kind::OfItself(of_itself - 1)
            } else {
                cross += 1;
                Kind::Cross(cross - 1)
            }
        };
        let kinds: Vec<Kind> = (0..layers).map(kind).collect();
        let of = |value: u32| bits(value as usize);
        let tokens = of(dims.chunk);
        let large = dims.expert_width > 128;
        let limb = if large { 20 } else { 16 };
        let mut all = alloc::vec![0; 24];
        for (axis, bits) in [
            (T, tokens),
            (N, bits(layers) + 1),
            (F, of(dims.expert_width)),
            (S, bits(samples)),
            (H, of(dims.heads)),
            (D, of(dims.head_dim)),
            (P, bits((1 << tokens) + dims.max_prefix as usize)),
            (M, 1),
            (A, of(dims.max_action_dim)),
            (G, of(dims.expert_mlp)),
            (SN, bits(of_itself) + 1),
            (V, of(dims.kv_heads)),
            (CN, bits(cross) + 1),
            (PC, of(dims.max_prefix)),
            (V2, of(dims.kv_heads)),
            (D2, of(dims.head_dim)),
            (F2, of(dims.expert_width)),
            (L, bits(layers)),
            (R, limb as u8 + 1),
            (X, if large { 20 } else { 17 }),
            (Q, 16),
            (M1, 0),
            (SN1, bits(of_itself)),
            (CN1, bits(cross)),
        ] {
            all[axis.0 as usize] = bits;
        }
        Self {
            bits: all,
            layers,
            kinds,
            limb,
        }
    }

    /// Bits of an axis.
    pub fn of(&self, axis: Axis) -> u8 {
        self.bits[axis.0 as usize]
    }

    /// The number of indices on an axis.
    pub fn count(&self, axis: Axis) -> usize {
        1 << self.of(axis)
    }

    /// Model and layer of an index on [`N`]. The layer may be beyond the last one.
    pub fn layer(&self, n: usize) -> (usize, usize) {
        (n >> self.of(L), n & (self.count(L) - 1))
    }

    /// The index on [`N`] of a layer of a model.
    pub fn n(&self, model: usize, layer: usize) -> usize {
        model << self.of(L) | layer
    }

    /// The axis of one of the models, where the upper half of `axis` is the update's.
    pub fn of_one_model(axis: Axis) -> Axis {
        match axis {
            N => L,
            SN => SN1,
            CN => CN1,
            _ => M1,
        }
    }

    /// Whether there are layers of cross-attention.
    pub fn has_cross(&self) -> bool {
        let cross = |kind: &Kind| matches!(kind, Kind::Cross(_));
        self.kinds.iter().any(cross)
    }

    /// For each index on [`N`] its index on [`SN`] or [`CN`].
    pub fn kind(&self, n: usize) -> Option<Kind> {
        let (model, layer) = self.layer(n);
        let half = |axis| model << (self.of(axis) - 1);
        self.kinds.get(layer).map(|kind| match *kind {
            Kind::OfItself(number) => Kind::OfItself(half(SN) | number),
            Kind::Cross(number) => Kind::Cross(half(CN) | number),
        })
    }
}
