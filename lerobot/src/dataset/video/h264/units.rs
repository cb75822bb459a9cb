//! The kinds of H.264's NAL units (ITU-T H.264, 7.4.1).

use crate::dataset::video::mp4::nal_config::NalConfig;
use crate::dataset::video::nal::Units;

const SLICE: u8 = 1;
const IDR_SLICE: u8 = 5;
const SEQUENCE_PARAMETERS: u8 = 7;

/// Whether a unit is a sequence parameter set.
pub(crate) fn is_sequence_parameters(unit: &[u8]) -> bool {
    kind(unit) == Some(SEQUENCE_PARAMETERS)
}

/// Whether a decoder that has seen nothing can begin with this sample: it has an IDR picture.
pub(crate) fn starts_anew(config: &NalConfig, sample: &[u8]) -> bool {
    Units::new(config, sample)
        .map_while(Result::ok)
        .any(|unit| kind(unit) == Some(IDR_SLICE))
}

/// Whether a sample holds a picture, or two fields of one.
pub(crate) fn has_picture(config: &NalConfig, sample: &[u8]) -> bool {
    Units::new(config, sample)
        .map_while(Result::ok)
        .any(|unit| matches!(kind(unit), Some(SLICE | IDR_SLICE)))
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
            parameter_sets: Vec::new(),
        };
        assert!(starts_anew(&config, &[1, 9, 1, 0x65]));
        assert!(!starts_anew(&config, &[1, 9, 1, 0x41]));
        assert!(!starts_anew(&config, &[9, 9]));
        assert!(has_picture(&config, &[1, 9, 1, 0x41]));
        assert!(!has_picture(&config, &[1, 9, 1, 6]));
    }
}
