//! H.264's kinds of NAL units (ITU-T H.264, 7.4.1).

use crate::dataset::video::mp4::nal_config::NalConfig;
use crate::dataset::video::nal::Units;

const SLICE: u8 = 1;
const IDR_SLICE: u8 = 5;
const SEQUENCE_PARAMETERS: u8 = 7;
/// Slices, whole or partitioned, of pictures that may refer to others.
const OTHER_SLICES: std::ops::RangeInclusive<u8> = SLICE..=4;
/// Of sequences and pictures, with extensions and subsets for layers.
const PARAMETER_SETS: [u8; 4] = [SEQUENCE_PARAMETERS, 8, 13, 15];

pub(crate) fn is_sequence_parameters(unit: &[u8]) -> bool {
    kind(unit) == Some(SEQUENCE_PARAMETERS)
}

/// Whether the sample has an IDR picture and no other.
pub(crate) fn starts_anew(config: &NalConfig, sample: &[u8]) -> bool {
    let units = || kinds(config, sample);
    units().any(|kind| kind == IDR_SLICE) && !units().any(|kind| OTHER_SLICES.contains(&kind))
}

pub(crate) fn has_other_parameter_sets(config: &NalConfig, sample: &[u8]) -> bool {
    let mut units = Units::new(config, sample).map_while(Result::ok);
    let tracks = |unit| config.parameter_sets.iter().any(|set| set == unit);
    units.any(|unit| kind(unit).is_some_and(|kind| PARAMETER_SETS.contains(&kind)) && !tracks(unit))
}

/// Whether a sample has a picture or two fields of one.
pub(crate) fn has_picture(config: &NalConfig, sample: &[u8]) -> bool {
    kinds(config, sample).any(|kind| matches!(kind, SLICE | IDR_SLICE))
}

fn kinds<'a>(config: &NalConfig, sample: &'a [u8]) -> impl Iterator<Item = u8> + 'a {
    let units = Units::new(config, sample).map_while(Result::ok);
    units.filter_map(kind)
}

fn kind(unit: &[u8]) -> Option<u8> {
    unit.first().map(|head| head & 0x1f)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_idr_picture_starts_anew() {
        let config = NalConfig {
            length_size: 1,
            parameter_sets: vec![vec![0x67, 1]],
        };
        assert!(starts_anew(&config, &[1, 9, 1, 0x65]));
        assert!(!starts_anew(&config, &[1, 9, 1, 0x41]));
        assert!(!starts_anew(&config, &[1, 0x41, 1, 0x65]));
        assert!(!starts_anew(&config, &[9, 9]));
        assert!(!has_other_parameter_sets(&config, &[2, 0x67, 1, 1, 0x65]));
        assert!(has_other_parameter_sets(&config, &[2, 0x67, 2, 1, 0x65]));
        assert!(has_other_parameter_sets(&config, &[2, 0x68, 1, 1, 0x65]));
        assert!(has_picture(&config, &[1, 9, 1, 0x41]));
        assert!(!has_picture(&config, &[1, 9, 1, 6]));
    }
}
