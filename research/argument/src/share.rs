//! Claims about sources become one claim about each source: what its multilinear polynomial is at one point that all share.

use crate::field::Extension;
use crate::multilinear::eq_bits;
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
    let mut places = Places {
        parts,
        point: &point,
        known: BTreeMap::new(),
    };
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
    require(expected == value, Refused::Equation("the sumcheck of the claims"))?;
    Ok((point, values))
}

/// What the weights of claims are at a point.
struct Places<'a> {
    parts: &'a Parts,
    point: &'a [Extension],
    known: BTreeMap<(PartId, u8), Extension>,
}

impl Places<'_> {
    /// The multilinear polynomial of a claim's weights over 2^`bits` values.
    fn weight(&mut self, about: &Weighted, bits: usize) -> Extension {
        let (parts, point) = (self.parts, self.point);
        let mut product = Extension::ONE;
        let mut fixed = (1usize << bits) - 1;
        for &(shift, id) in &about.parts {
            let part = parts.get(id);
            let start = shift as usize;
            let end = start + part.bits();
            fixed &= !((1 << end) - (1 << start));
            let at = self.known.entry((id, shift));
            product *= *at.or_insert_with(|| part.at(&point[start..end]));
        }
        // Where no index stands, the bit is that of the offset.
        for bit in (0..bits).filter(|bit| fixed >> bit & 1 == 1) {
            product *= eq_bits(about.offset >> bit & 1, &point[bit..=bit]);
        }
        product
    }
}
