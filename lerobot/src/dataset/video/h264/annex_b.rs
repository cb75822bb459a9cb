//! From an mp4's samples to the byte stream that the decoder takes (ITU-T H.264, annex B): NAL units behind start codes instead
//! of lengths.

use crate::dataset::video::mp4::avc_config::AvcConfig;

const START_CODE: [u8; 4] = [0, 0, 0, 1];
const IDR_SLICE: u8 = 5;
const SEQUENCE_PARAMETERS: u8 = 7;

/// The byte stream of one sample, with the track's parameter sets before a key frame. `sps` checks every sequence parameter
/// set and gives what goes into the stream for it.
pub(crate) fn stream(
    config: &AvcConfig,
    sample: &[u8],
    key: bool,
    sps: impl Fn(&[u8]) -> Result<Vec<u8>, String>,
) -> Result<Vec<u8>, String> {
    let sets = config.parameter_sets.iter().filter(|_| key);
    let units = sets
        .map(|set| Ok(&set[..]))
        .chain(Units::new(config, sample));
    let mut stream = Vec::with_capacity(sample.len() + 64);
    for unit in units {
        let unit = without_trailing_zeros(unit?);
        let kind = kind(unit).ok_or("holds an empty NAL unit")?;
        // The decoder would take the bytes after it for another unit, which was not checked.
        if unit.windows(3).any(|w| w[..2] == [0, 0] && w[2] <= 2) {
            return Err("holds a start code within a NAL unit".into());
        }
        stream.extend_from_slice(&START_CODE);
        match kind {
            SEQUENCE_PARAMETERS => stream.extend(sps(unit)?),
            _ => stream.extend_from_slice(unit),
        }
    }
    Ok(stream)
}

/// Whether a decoder that has seen nothing can begin with this sample: it has an IDR picture.
pub(crate) fn starts_anew(config: &AvcConfig, sample: &[u8]) -> bool {
    Units::new(config, sample)
        .map_while(Result::ok)
        .any(|unit| kind(unit) == Some(IDR_SLICE))
}

fn kind(unit: &[u8]) -> Option<u8> {
    unit.first().map(|head| head & 0x1f)
}

fn without_trailing_zeros(unit: &[u8]) -> &[u8] {
    let end = unit.iter().rposition(|&b| b != 0).map_or(0, |at| at + 1);
    &unit[..end]
}

/// The NAL units of a sample; ends after the first error.
struct Units<'a> {
    length_size: usize,
    rest: &'a [u8],
}

impl<'a> Units<'a> {
    fn new(config: &AvcConfig, sample: &'a [u8]) -> Self {
        Self {
            length_size: config.length_size,
            rest: sample,
        }
    }
}

impl<'a> Iterator for Units<'a> {
    type Item = Result<&'a [u8], String>;

    fn next(&mut self) -> Option<Self::Item> {
        let all = std::mem::take(&mut self.rest);
        if all.is_empty() {
            return None;
        }
        let unit = all
            .split_at_checked(self.length_size)
            .and_then(|(length, rest)| {
                let length = length.iter().fold(0, |n, &b| n << 8 | usize::from(b));
                rest.split_at_checked(length)
            });
        Some(match unit {
            Some((unit, rest)) => {
                self.rest = rest;
                Ok(unit)
            }
            None => Err(format!(
                "holds a NAL unit that is longer than the {} bytes left",
                all.len()
            )),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config(length_size: usize) -> AvcConfig {
        AvcConfig {
            length_size,
            parameter_sets: vec![vec![0x67, 1], vec![0x68, 2]],
        }
    }

    fn of(length_size: usize, sample: &[u8], key: bool) -> Result<Vec<u8>, String> {
        stream(&config(length_size), sample, key, |sps| Ok(sps.to_vec()))
    }

    #[test]
    fn lengths_become_start_codes_and_key_frames_get_the_parameter_sets() {
        assert_eq!(of(1, &[2, 0x41, 9], false).unwrap(), [0, 0, 0, 1, 0x41, 9]);
        assert_eq!(
            of(2, &[0, 1, 0x65, 0, 2, 0x65, 7], true).unwrap(),
            [0, 0, 0, 1, 0x67, 1, 0, 0, 0, 1, 0x68, 2, 0, 0, 0, 1, 0x65, 0, 0, 0, 1, 0x65, 7]
        );
        // Zeros after a unit do not belong to it.
        assert_eq!(
            of(1, &[3, 0x41, 9, 0], false).unwrap(),
            [0, 0, 0, 1, 0x41, 9]
        );
    }

    #[test]
    fn hidden_and_broken_units_are_refused() {
        // This is a sequence parameter set that only the decoder would see.
        let hidden = of(1, &[6, 0x41, 0, 0, 1, 0x67, 1], false).unwrap_err();
        assert_eq!(hidden, "holds a start code within a NAL unit");
        assert!(of(1, &[5, 0x41, 0, 0, 3, 1], false).is_ok());
        let long = of(1, &[9, 0x41], false).unwrap_err();
        assert_eq!(
            long,
            "holds a NAL unit that is longer than the 2 bytes left"
        );
        assert!(of(4, &[0, 0], false).is_err());
        assert!(of(1, &[0], false).is_err());
        let refused = stream(&config(1), &[2, 0x67, 1], false, |_| Err("no".into()));
        assert_eq!(refused, Err("no".into()));
    }

    #[test]
    fn an_idr_picture_starts_anew() {
        assert!(starts_anew(&config(1), &[1, 9, 1, 0x65]));
        assert!(!starts_anew(&config(1), &[1, 9, 1, 0x41]));
        assert!(!starts_anew(&config(1), &[9, 9]));
    }
}
