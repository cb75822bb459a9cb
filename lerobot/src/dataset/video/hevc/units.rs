//! HEVC's kinds of NAL units (ITU-T H.265, 7.4.2.2), and where decoding can begin.

use std::ops::RangeInclusive;

use crate::dataset::video::mp4::nal_config::NalConfig;
use crate::dataset::video::nal::Units;

const SEQUENCE_PARAMETERS: u8 = 33;
/// Pictures shown before their key frame that refer to what came before it.
const SKIPPED_LEADING: RangeInclusive<u8> = 8..=9;
/// Pictures that refer to no other.
const KEY_PICTURES: RangeInclusive<u8> = 16..=21;
/// Key pictures after which nothing refers to earlier ones.
const IDR_PICTURES: RangeInclusive<u8> = 19..=20;

/// How a sample depends on earlier ones.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Dependence {
    /// Nothing later refers to what came before.
    Idr,
    /// Only pictures shown before it refer to what came before.
    OpenKey,
    /// Cannot be decoded if decoding began at its key frame.
    SkippedLeading,
    /// Refers to pictures from its key frame on, or is broken.
    Other,
}

pub(crate) fn is_sequence_parameters(unit: &[u8]) -> bool {
    kind(unit) == Some(SEQUENCE_PARAMETERS)
}

/// Whether a unit belongs to the base pictures, not to a second view or a finer layer.
pub(crate) fn is_base_layer(unit: &[u8]) -> bool {
    matches!(unit, [first, second, ..] if first & 1 == 0 && second >> 3 == 0)
}

pub(crate) fn dependence(config: &NalConfig, sample: &[u8]) -> Dependence {
    let mut slices = Units::new(config, sample)
        .map_while(Result::ok)
        .filter_map(kind)
        .filter(|kind| *kind < 32);
    match slices.next() {
        Some(kind) if IDR_PICTURES.contains(&kind) => Dependence::Idr,
        Some(kind) if KEY_PICTURES.contains(&kind) => Dependence::OpenKey,
        Some(kind) if SKIPPED_LEADING.contains(&kind) => Dependence::SkippedLeading,
        _ => Dependence::Other,
    }
}

/// Pictures that begin in a sample.
pub(crate) fn pictures(config: &NalConfig, sample: &[u8]) -> usize {
    Units::new(config, sample)
        .map_while(Result::ok)
        .filter(|unit| kind(unit).is_some_and(|kind| kind < 32))
        // A picture's first slice sets the bit after the header.
        .filter(|unit| unit.get(2).is_some_and(|byte| byte >> 7 == 1))
        .count()
}

fn kind(unit: &[u8]) -> Option<u8> {
    unit.first().map(|head| head >> 1 & 0x3f)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_slice_decides() {
        let config = NalConfig {
            length_size: 1,
            parameter_sets: Vec::new(),
        };
        let of = |kinds: &[u8]| {
            let sample: Vec<u8> = kinds.iter().flat_map(|kind| [2, kind << 1, 1]).collect();
            dependence(&config, &sample)
        };
        assert_eq!(of(&[33, 39, 19]), Dependence::Idr);
        assert_eq!(of(&[21]), Dependence::OpenKey);
        assert_eq!(of(&[9]), Dependence::SkippedLeading);
        assert_eq!(of(&[1, 20]), Dependence::Other);
        assert_eq!(of(&[]), Dependence::Other);
        assert_eq!(dependence(&config, &[9, 38]), Dependence::Other);
        // A picture of two slices, and a unit of no picture with this bit.
        let slices = [3, 2, 1, 0x80, 3, 2, 1, 0x40, 3, 0x4e, 1, 0x80];
        assert_eq!(pictures(&config, &slices), 1);
        assert!(is_sequence_parameters(&[0x42]));
        assert!(!is_sequence_parameters(&[]));
    }
}
