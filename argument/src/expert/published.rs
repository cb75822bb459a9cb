//! What an argument leaves to check: claims about the weights of both models, and about public tables, at random points. They travel with a
//! proof. Whoever has the weights computes the values again.

use super::builder::{TABLES, WEIGHTS};
use super::evaluation::layers::Expert;
use super::evaluation::linear::gated;
use super::statement::packed;
use super::weights::{Claimed, Matrices};
use crate::field::{Extension, Goldilocks};
use crate::hash::{digest_of_words, SpongeDomain};
use crate::party::{ValueClaim, Weighted};
use crate::relation::{ColumnSource, Part, PartId, Parts, Tensor};
use crate::transcript::{require, Refused};
use alloc::vec;
use alloc::vec::Vec;
use zk0_circuits::model::arithmetic::tables::exp2_negative;
use zk0_circuits::Digest;

/// Claims that name their weights.
pub struct Published {
    /// The parts that claims name.
    pub parts: Parts,
    /// The claims.
    pub claims: Vec<ValueClaim>,
}

/// Most bits of an axis. The largest is that of the table of powers.
const MOST_BITS: u32 = 20;

impl Published {
    /// A digest of the claims, and of the fraction bits that the argument holds with.
    pub fn digest(&self, scales: &[Vec<i16>; 2]) -> Digest {
        digest(scales, &self.words())
    }

    /// The claims as words: how many claims there are; for each its source and number of parts, its offset, its parts and its value; then the
    /// weights of all parts that claims name, in the order in which they name them first.
    pub fn words(&self) -> Vec<u64> {
        let mut words = vec![self.claims.len() as u64];
        let mut used: Vec<PartId> = vec![];
        for claim in &self.claims {
            let Weighted {
                source,
                offset,
                parts,
                ..
            } = &claim.about;
            words.push(source.0 as u64 | (parts.len() as u64) << 8);
            words.push(*offset as u64);
            for &(shift, id) in parts {
                let known = used.iter().position(|&own| own == id);
                let number = known.unwrap_or_else(|| {
                    used.push(id);
                    used.len() - 1
                });
                words.push(shift as u64 | (number as u64) << 8);
            }
            words.extend(claim.value.0.map(Goldilocks::value));
        }
        for id in used {
            let (kind, weights) = match self.parts.get(id) {
                Part::Point(point) => (0, &point[..]),
                Part::Vector(weights) => (1, &weights[..]),
                Part::Ones(bits) => (2 + *bits as u64, &[][..]),
            };
            words.extend([kind, weights.len() as u64]);
            let coefficients = Extension::coefficients(weights);
            words.extend(coefficients.iter().map(|value| value.value()));
        }
        words
    }

    /// Reads [`Self::words`]. `None` if they are not claims. Whoever reads them compares their [`digest`].
    pub fn from_words(words: &[u64]) -> Option<Self> {
        let mut reader = Reader(words);
        // A claim takes four words at least, so that nothing larger than the words is allocated.
        let claims = (0..reader.count(words.len() / 4)?)
            .map(|_| reader.claim())
            .collect::<Option<Vec<_>>>()?;
        let numbers = claims.iter().flat_map(|claim| &claim.about.parts);
        let used = numbers.map(|(_, id)| id.number() + 1).max().unwrap_or(0);
        let mut parts = Parts::default();
        for _ in 0..used {
            parts.add(reader.part()?);
        }
        reader.0.is_empty().then_some(Self { parts, claims })
    }

    /// The sums that claims are about, as far as the weights of one model go: 0 for the base, 1 for the update. `tensor` returns the values of the
    /// expert's tensor with a number. It is called once for each tensor, and one tensor is in memory at a time.
    ///
    /// # Errors
    /// `tensor` fails, or a claim is about other weights than the expert's.
    pub fn sums<M: AsRef<[i16]>, E: From<Refused>>(
        &self,
        expert: &Expert,
        model: usize,
        tensors: usize,
        mut tensor: impl FnMut(usize) -> Result<M, E>,
    ) -> Result<Vec<Extension>, E> {
        let claimed: Vec<Option<(&Matrices, Claimed)>> = self
            .claims
            .iter()
            .map(|claim| self.about_weights(expert, claim))
            .collect::<Result<_, _>>()?;
        let mut sums = vec![Extension::ZERO; self.claims.len()];
        for number in 0..tensors {
            let values = tensor(number)?;
            for (sum, claimed) in sums.iter_mut().zip(&claimed) {
                let Some((matrices, claimed)) = claimed else {
                    continue;
                };
                for matrix in matrices.made_of(model, number) {
                    *sum += matrices.sum(matrix, claimed, values.as_ref());
                }
            }
        }
        Ok(sums)
    }

    /// Which matrices a claim is about, and the weights of their values. `None` for a claim about a table.
    fn about_weights<'e>(
        &self,
        expert: &'e Expert,
        claim: &ValueClaim,
    ) -> Result<Option<(&'e Matrices, Claimed)>, Refused> {
        if claim.about.source != WEIGHTS {
            return Ok(None);
        }
        let tensors = &expert.builder.relations.tensors;
        let found = expert.weights.iter().find_map(|matrices| {
            let claimed = matrices.claimed(&tensors[matrices.tensor], &self.parts, &claim.about);
            Some((matrices, claimed?))
        });
        match found {
            Some(found) => Ok(Some(found)),
            None => Err(Refused::Equation("the place of a claim about weights")),
        }
    }

    /// Checks all claims, with what [`Self::sums`] gives for the base and for the update.
    pub fn check(&self, expert: &Expert, sums: [&[Extension]; 2]) -> Result<(), Refused> {
        for ((claim, &base), &update) in self.claims.iter().zip(sums[0]).zip(sums[1]) {
            let (value, what) = match claim.about.source {
                WEIGHTS => (base + update, "a claim about weights"),
                _ => (self.of_table(expert, claim)?, "a claim about a table"),
            };
            require(value == claim.value, Refused::Equation(what))?;
        }
        let counts = sums.map(<[_]>::len);
        require(
            counts == [self.claims.len(); 2],
            Refused::Equation("the number of claims about weights"),
        )
    }

    fn of_table(&self, expert: &Expert, claim: &ValueClaim) -> Result<Extension, Refused> {
        let wrong = Refused::Equation("the place of a claim about a table");
        let about = &claim.about;
        let [(0, id)] = about.parts[..] else {
            return Err(wrong);
        };
        require(about.source == TABLES, wrong)?;
        let part = self.parts.get(id);
        let mut tables = tables(expert);
        let found = tables.find(|(tensor, _)| {
            tensor.offset == about.offset && tensor.places[0].bits as usize == part.bits()
        });
        let (_, value) = found.ok_or(wrong)?;
        let weights = part.weights();
        let rows = weights.iter().enumerate();
        Ok(rows
            .map(|(row, &weight)| weight.scale(Goldilocks::from_i64(value(row))))
            .sum())
    }
}

/// [`Published::digest`] of claims with these words.
pub fn digest(scales: &[Vec<i16>; 2], claims: &[u64]) -> Digest {
    let mut words = vec![];
    for scales in scales {
        words.push(scales.len() as u64);
        words.extend(packed(scales));
    }
    words.extend(claims);
    digest_of_words(SpongeDomain::Published, &words).into()
}

/// The value of a row of a table.
type Row = alloc::boxed::Box<dyn Fn(usize) -> i64>;

/// The tables' columns, with the values of their rows.
pub fn tables(expert: &Expert) -> impl Iterator<Item = (&Tensor, Row)> {
    let tensors = &expert.builder.relations.tensors;
    let power: Row = alloc::boxed::Box::new(|row| exp2_negative((row as u64 + 1) >> 1) as i64);
    let powers = (&tensors[expert.powers.tensor], power);
    let gates = expert.gates.iter().map(|&(bits, column)| {
        let gate: Row = alloc::boxed::Box::new(move |row| gated(row as i64 - (1 << 15), bits));
        (&tensors[column.tensor], gate)
    });
    core::iter::once(powers).chain(gates)
}

/// What is left to read.
struct Reader<'a>(&'a [u64]);

impl<'a> Reader<'a> {
    fn words(&mut self, count: usize) -> Option<&'a [u64]> {
        let (now, later) = self.0.split_at_checked(count)?;
        self.0 = later;
        Some(now)
    }

    fn word(&mut self) -> Option<u64> {
        Some(self.words(1)?[0])
    }

    /// A number up to `most`.
    fn count(&mut self, most: usize) -> Option<usize> {
        let count = usize::try_from(self.word()?).ok()?;
        (count <= most).then_some(count)
    }

    fn elements(&mut self, count: usize) -> Option<Vec<Extension>> {
        let words = self.words(count.checked_mul(2)?)?;
        let coefficients = Goldilocks::of_words(words).ok()?;
        Some(Extension::of_coefficients(coefficients).to_vec())
    }

    fn claim(&mut self) -> Option<ValueClaim> {
        let head = self.word()?;
        let (source, parts) = (ColumnSource(head as u8), head >> 8);
        let offset = usize::try_from(self.word()?).ok()?;
        let parts = (parts <= self.0.len() as u64).then_some(parts)?;
        let part = |reader: &mut Self| {
            let word = reader.word()?;
            let number = u32::try_from(word >> 8).ok()?;
            Some((word as u8, PartId::of_number(number)))
        };
        let parts = (0..parts).map(|_| part(self)).collect::<Option<_>>()?;
        let value = self.elements(1)?[0];
        let about = Weighted {
            source,
            offset,
            parts,
            instances: None,
        };
        Some(ValueClaim { about, value })
    }

    fn part(&mut self) -> Option<Part> {
        let (kind, length) = (self.word()?, self.word()?);
        let weights = self.elements(usize::try_from(length).ok()?)?;
        match kind {
            0 if length <= MOST_BITS as u64 => Some(Part::Point(weights)),
            1 if length.is_power_of_two() => Some(Part::Vector(weights)),
            2.. if kind - 2 <= MOST_BITS as u64 && length == 0 => Some(Part::Ones(kind as u32 - 2)),
            _ => None,
        }
    }
}
