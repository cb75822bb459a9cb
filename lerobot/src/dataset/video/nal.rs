//! From an mp4's samples to a decoder's byte stream (annex B of ITU-T H.264 and of H.265): NAL units with start codes instead of lengths.

use std::borrow::Cow;

use crate::dataset::video::mp4::nal_config::NalConfig;

const START_CODE: [u8; 4] = [0, 0, 0, 1];

/// A sample's byte stream, after the track's parameter sets if `sets`. `checked` sees every unit and gives what replaces it.
pub(crate) fn stream(
    config: &NalConfig,
    sample: &[u8],
    sets: bool,
    checked: impl for<'a> Fn(&'a [u8]) -> Result<Cow<'a, [u8]>, String>,
) -> Result<Vec<u8>, String> {
    let sets = config.parameter_sets.iter().filter(|_| sets);
    let units = sets
        .map(|set| Ok(&set[..]))
        .chain(Units::new(config, sample));
    let mut stream = Vec::with_capacity(sample.len() + 64);
    for unit in units {
        let unit = without_trailing_zeros(unit?);
        if unit.is_empty() {
            return Err("holds an empty NAL unit".into());
        }
        // The decoder would take the bytes after it for another, unchecked unit.
        if unit.windows(3).any(|w| w[..2] == [0, 0] && w[2] <= 2) {
            return Err("holds a start code within a NAL unit".into());
        }
        stream.extend_from_slice(&START_CODE);
        stream.extend_from_slice(&checked(unit)?);
    }
    Ok(stream)
}

fn without_trailing_zeros(unit: &[u8]) -> &[u8] {
    let end = unit.iter().rposition(|&b| b != 0).map_or(0, |at| at + 1);
    &unit[..end]
}

/// A sample's NAL units; ends after the first error.
pub(crate) struct Units<'a> {
    length_size: usize,
    rest: &'a [u8],
}

impl<'a> Units<'a> {
    pub fn new(config: &NalConfig, sample: &'a [u8]) -> Self {
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

    fn config(length_size: usize) -> NalConfig {
        NalConfig {
            length_size,
            parameter_sets: vec![vec![0x67, 1], vec![0x68, 2]],
        }
    }

    fn of(length_size: usize, sample: &[u8], key: bool) -> Result<Vec<u8>, String> {
        stream(&config(length_size), sample, key, |unit| Ok(unit.into()))
    }

    #[test]
    fn lengths_become_start_codes_and_key_frames_get_the_parameter_sets() {
        assert_eq!(of(1, &[2, 0x41, 9], false).unwrap(), [0, 0, 0, 1, 0x41, 9]);
        assert_eq!(
            of(2, &[0, 1, 0x65, 0, 2, 0x65, 7], true).unwrap(),
            [0, 0, 0, 1, 0x67, 1, 0, 0, 0, 1, 0x68, 2, 0, 0, 0, 1, 0x65, 0, 0, 0, 1, 0x65, 7]
        );
        // Zeros after a unit are not part of it.
        assert_eq!(
            of(1, &[3, 0x41, 9, 0], false).unwrap(),
            [0, 0, 0, 1, 0x41, 9]
        );
    }

    #[test]
    fn hidden_and_broken_units_are_refused() {
        // A sequence parameter set that only the decoder would see.
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
}
