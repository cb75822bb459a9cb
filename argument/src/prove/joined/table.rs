//! The tables of a sum, and the pieces of them that one core works on.

use crate::field::lazy::LazyFactor;
use crate::field::{Extension, Goldilocks};
use rayon::prelude::*;

/// The values of a multilinear polynomial.
pub enum MultilinearTable {
    /// In the base field: half the memory, and cheaper products.
    Base(Vec<Goldilocks>),
    /// In the extension.
    Extension(Vec<Extension>),
    /// In the base field, with room for the values that are left when a variable is bound.
    Bound(Vec<Goldilocks>, Vec<Extension>),
}

impl From<Vec<Goldilocks>> for MultilinearTable {
    fn from(values: Vec<Goldilocks>) -> Self {
        Self::Base(values)
    }
}

impl From<Vec<Extension>> for MultilinearTable {
    /// Values that all are in the base field are taken for such.
    fn from(values: Vec<Extension>) -> Self {
        if values.iter().all(|value| value.0[1] == Goldilocks::ZERO) {
            Self::Base(values.par_iter().map(|value| value.0[0]).collect())
        } else {
            Self::Extension(values)
        }
    }
}

/// Values at the same places of a table's parts: where the highest variable, or the two highest ones, are 0 and 1.
pub enum Piece<'a> {
    /// The variable is 0 or 1.
    Base([&'a [Goldilocks]; 2]),
    /// Likewise.
    Extension([&'a [Extension]; 2]),
    /// The highest variable is bound, and where the one below is 0 or 1, the values are written to the targets.
    BoundBase(LazyFactor, [&'a [Goldilocks]; 4], [&'a mut [Extension]; 2]),
    /// Likewise. The targets hold the values where the highest variable is 0, and the others those where it is 1.
    BoundExtension(LazyFactor, [&'a mut [Extension]; 2], [&'a [Extension]; 2]),
}

impl MultilinearTable {
    /// How many values there are.
    pub fn len(&self) -> usize {
        match self {
            Self::Base(values) | Self::Bound(values, _) => values.len(),
            Self::Extension(values) => values.len(),
        }
    }

    /// Makes room for what is left when a variable is bound.
    pub fn make_room(&mut self) {
        if let Self::Base(values) = self {
            let room = vec![Extension::ZERO; values.len() / 2];
            *self = Self::Bound(core::mem::take(values), room);
        }
    }

    /// All pieces of up to `size` values. With a challenge, the highest variable is bound to it first. `half` is half the number of values
    /// that are left.
    pub fn pieces<'a>(
        &'a mut self,
        half: usize,
        challenge: Option<Extension>,
        size: usize,
    ) -> Box<dyn Iterator<Item = Piece<'a>> + 'a> {
        match (self, challenge.map(LazyFactor::new)) {
            (Self::Bound(values, room), Some(factor)) => {
                let parts = values.chunks_exact(half).map(|part| part.chunks(size));
                let targets = room
                    .chunks_exact_mut(half)
                    .map(|part| part.chunks_mut(size));
                let (mut parts, mut targets) =
                    (parts.collect::<Vec<_>>(), targets.collect::<Vec<_>>());
                Box::new(core::iter::from_fn(move || {
                    let [a, b, c, d] = &mut parts[..] else {
                        return None;
                    };
                    let [low, high] = &mut targets[..] else {
                        return None;
                    };
                    let sources = [a.next()?, b.next()?, c.next()?, d.next()?];
                    Some(Piece::BoundBase(
                        factor,
                        sources,
                        [low.next()?, high.next()?],
                    ))
                }))
            }
            (Self::Extension(values), Some(factor)) => {
                let (low, high) = values.split_at_mut(2 * half);
                let (a, b) = low.split_at_mut(half);
                let (c, d) = high.split_at(half);
                let targets = a.chunks_mut(size).zip(b.chunks_mut(size));
                let others = c.chunks(size).zip(d.chunks(size));
                Box::new(
                    targets
                        .zip(others)
                        .map(move |((a, b), (c, d))| Piece::BoundExtension(factor, [a, b], [c, d])),
                )
            }
            (Self::Base(values) | Self::Bound(values, _), _) => {
                let (zero, one) = values.split_at(half);
                let pairs = zero.chunks(size).zip(one.chunks(size));
                Box::new(pairs.map(|(zero, one)| Piece::Base([zero, one])))
            }
            (Self::Extension(values), None) => {
                let (zero, one) = values.split_at(half);
                let pairs = zero.chunks(size).zip(one.chunks(size));
                Box::new(pairs.map(|(zero, one)| Piece::Extension([zero, one])))
            }
        }
    }

    /// Keeps the `len` values that are left after a pass over the pieces.
    pub fn shrink(&mut self, len: usize) {
        match self {
            Self::Base(_) => {}
            Self::Extension(values) => values.truncate(len),
            Self::Bound(_, room) => *self = Self::Extension(core::mem::take(room)),
        }
    }

    /// Binds the last variable.
    pub fn bind_last(&mut self, challenge: Extension) {
        let factor = LazyFactor::new(challenge);
        let value = match self {
            Self::Base(values) | Self::Bound(values, _) => {
                factor.between_base(values[0], values[1])
            }
            Self::Extension(values) => factor.between(values[0], values[1]),
        };
        *self = Self::Extension(vec![value]);
    }

    /// The first value.
    pub fn first(&self) -> Extension {
        match self {
            Self::Base(values) | Self::Bound(values, _) => values[0].into(),
            Self::Extension(values) => values[0],
        }
    }
}
