//! Claims about sources become one claim about each source: what its multilinear polynomial is at one point that all share.

use crate::field::Extension;
use crate::multilinear::eq_table;
use crate::protocol::{Claim, Party, Weighted};
use crate::relation::{Part, PartId, Parts, Source};
use crate::transcript::{require, Refused};
use alloc::collections::BTreeMap;
use alloc::vec;
use alloc::vec::Vec;

/// A point, and what the polynomials of all sources are there. A source with fewer variables than the point has is at its first coordinates.
pub type Shared = (Vec<Extension>, Vec<Extension>);

/// Makes one claim about each of `sources` of all `claims`. Each source comes with its number of variables.
pub fn share<P: Party>(
    party: &mut P,
    parts: &mut Parts,
    sources: &[(Source, usize)],
    claims: &[Claim],
) -> Result<Shared, Refused> {
    let gamma = party.challenge();
    let (point, value) = party.reduce_claims(parts, sources, claims, gamma)?;
    let mut values = Vec::with_capacity(sources.len());
    for &(source, bits) in sources {
        let whole = Weighted {
            source,
            offset: 0,
            parts: vec![(0, parts.add(Part::Point(point[..bits].to_vec())))],
        };
        values.push(party.value(parts, &whole)?);
    }
    let mut weights = vec![Extension::ZERO; sources.len()];
    let mut places = Places::new(parts, &point);
    let mut power = Extension::ONE;
    for claim in claims {
        let about = &claim.about;
        let Some(number) = sources.iter().position(|(of, _)| *of == about.source) else {
            return Err(Refused::Equation("the source of a claim"));
        };
        weights[number] += power * places.weight(about, sources[number].1);
        power *= gamma;
    }
    let expected: Extension = weights.iter().zip(&values).map(|(&w, &v)| w * v).sum();
    require(
        expected == value,
        Refused::Equation("the sumcheck of the claims"),
    )?;
    Ok((point, values))
}

/// What the weights of claims are at a point.
struct Places<'a> {
    parts: &'a Parts,
    point: &'a [Extension],
    /// Of the bits of each offset at which no index stands, by the offset and these bits.
    fixed: BTreeMap<(usize, usize), Extension>,
    /// For each part what it is at the coordinates from a shift on.
    known: Vec<Vec<(u8, Extension)>>,
    /// Tables of coordinates, by the first one and the number.
    tables: Vec<((usize, usize), Vec<Extension>)>,
}

impl<'a> Places<'a> {
    fn new(parts: &'a Parts, point: &'a [Extension]) -> Self {
        Self {
            parts,
            point,
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
        let point = self.point;
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
        product
    }

    /// The multilinear polynomial of a part at the coordinates from `shift` on.
    fn part(&mut self, id: PartId, shift: u8) -> Extension {
        let known = &self.known[id.number()];
        if let Some((_, value)) = known.iter().find(|(of, _)| *of == shift) {
            return *value;
        }
        let part = self.parts.get(id);
        let (start, bits) = (shift as usize, part.bits());
        let coordinates = &self.point[start..start + bits];
        let value = match part {
            Part::Vector(weights) => {
                let key = (start, bits);
                let known = self.tables.iter().position(|(of, _)| *of == key);
                let place = known.unwrap_or_else(|| {
                    self.tables.push((key, eq_table(coordinates)));
                    self.tables.len() - 1
                });
                let terms = self.tables[place].1.iter().zip(weights);
                terms.map(|(&a, &b)| a * b).sum()
            }
            _ => part.at(coordinates),
        };
        self.known[id.number()].push((shift, value));
        value
    }
}
