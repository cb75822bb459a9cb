//! Claims about sources become one claim about each source: what its multilinear polynomial is at one point that all share.

use crate::field::Extension;
use crate::form::Secret;
use crate::multilinear::eq_table;
use crate::party::{Party, Sources, ValueClaim, Weighted};
use crate::relation::{Part, PartId, Parts};
use crate::sumcheck::JoinedPoint;
use crate::transcript::Refused;
use alloc::collections::BTreeMap;
use alloc::vec;
use alloc::vec::Vec;

/// A point, and what the polynomials of all sources are there. A source with fewer variables than the point has is at its first coordinates.
pub type Shared<V> = (JoinedPoint, Vec<V>);

/// Makes one claim about each of `sources` of all `claims`.
pub fn share<P: Party>(
    party: &mut P,
    parts: &mut Parts,
    sources: &Sources<'_>,
    claims: &[ValueClaim<P::Value>],
) -> Result<Shared<P::Value>, Refused> {
    let gamma = party.challenge();
    let (joined, value) = party.reduce_claims(parts, sources, claims, gamma)?;
    let instances = parts.add(Part::Point(joined.instances.clone()));
    let mut values = Vec::with_capacity(sources.all.len());
    for &(source, bits) in sources.all {
        let whole = Weighted {
            source,
            offset: 0,
            parts: vec![(0, parts.add(Part::Point(joined.own[..bits].to_vec())))],
            instances: Some(instances),
        };
        values.push(party.value(parts, &whole)?);
    }
    let mut weights = vec![Extension::ZERO; sources.all.len()];
    let mut places = Places::new(parts, &joined);
    let mut power = Extension::ONE;
    for claim in claims {
        let about = &claim.about;
        let mut all = sources.all.iter();
        let Some(number) = all.position(|(of, _)| *of == about.source) else {
            return Err(Refused::Equation("the source of a claim"));
        };
        weights[number] += power * places.weight(about, sources.all[number].1);
        power *= gamma;
    }
    let mut expected = P::Value::default();
    for ((weight, value), &(_, bits)) in weights.into_iter().zip(&values).zip(sources.all) {
        expected.add(weight * joined.absent(bits, true), value);
    }
    party.zero("the sumcheck of the claims", expected.minus(&value))?;
    Ok((joined, values))
}

/// What the weights of claims are at a point.
struct Places<'a> {
    parts: &'a Parts,
    joined: &'a JoinedPoint,
    /// Of the bits of each offset at which no index stands, by the offset and these bits.
    fixed: BTreeMap<(usize, usize), Extension>,
    /// For each part what it is at the coordinates from a shift on.
    known: Vec<Vec<(u8, Extension)>>,
    /// Tables of coordinates, by the first one and the number.
    tables: Vec<((usize, usize), Vec<Extension>)>,
    /// What the weights of instances are there.
    instances: Vec<(PartId, Extension)>,
}

impl<'a> Places<'a> {
    fn new(parts: &'a Parts, joined: &'a JoinedPoint) -> Self {
        Self {
            parts,
            joined,
            instances: vec![],
            fixed: BTreeMap::new(),
            known: vec![vec![]; parts.count()],
            tables: vec![],
        }
    }

    /// The multilinear polynomial of a claim's weights over 2^`bits` values.
    fn weight(&mut self, about: &Weighted, bits: usize) -> Extension {
        let mut fixed = (1usize << bits) - 1;
        for &(shift, id) in &about.parts {
            fixed &= !(((1 << self.parts.get(id).bits()) - 1) << shift);
        }
        let point = &self.joined.own[..];
        let key = (about.offset, fixed);
        let mut product = *self.fixed.entry(key).or_insert_with(|| {
            // Where no index stands, the bit is that of the offset.
            let fixed = (0..bits).filter(|bit| fixed >> bit & 1 == 1);
            fixed.fold(Extension::ONE, |product, bit| {
                let one = product * point[bit];
                match about.offset >> bit & 1 {
                    1 => one,
                    _ => product - one,
                }
            })
        });
        for &(shift, id) in &about.parts {
            product *= self.part(id, shift);
        }
        match about.instances {
            Some(id) => product * self.instances(id),
            None => product,
        }
    }

    /// The multilinear polynomial of weights of instances.
    fn instances(&mut self, id: PartId) -> Extension {
        if let Some((_, value)) = self.instances.iter().find(|(of, _)| *of == id) {
            return *value;
        }
        let value = self.parts.get(id).at(&self.joined.instances);
        self.instances.push((id, value));
        value
    }

    /// The multilinear polynomial of a part at the coordinates from `shift` on.
    fn part(&mut self, id: PartId, shift: u8) -> Extension {
        let known = &self.known[id.number()];
        if let Some((_, value)) = known.iter().find(|(of, _)| *of == shift) {
            return *value;
        }
        let part = self.parts.get(id);
        let (start, bits) = (shift as usize, part.bits());
        let coordinates = &self.joined.own[start..start + bits];
        let value = match part {
            Part::Vector(weights) => {
                let key = (start, bits);
                let known = self.tables.iter().position(|(of, _)| *of == key);
                let place = known.unwrap_or_else(|| {
                    self.tables.push((key, eq_table(coordinates)));
                    self.tables.len() - 1
                });
                Extension::dot_of_extensions(&self.tables[place].1, weights)
            }
            _ => part.at(coordinates),
        };
        self.known[id.number()].push((shift, value));
        value
    }
}
