//! An open mp4 and what its parameter sets declare.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use crate::dataset::video::kind::PictureKind;
use crate::dataset::video::mp4::nal_config::NalConfig;
use crate::dataset::video::mp4::sample::Mp4Codec;
use crate::dataset::video::mp4::track::Mp4Track;
use crate::dataset::video::nal::Units;
use crate::dataset::video::{h264, hevc};
use crate::dataset::DatasetError;

pub(super) struct VideoSource {
    pub path: PathBuf,
    file: File,
    pub track: Mp4Track,
}

impl VideoSource {
    /// Opens an mp4 whose shown pictures are `height x width`.
    pub fn open(path: &Path, height: usize, width: usize) -> Result<Self, DatasetError> {
        let mut file = File::open(path).map_err(|e| DatasetError::io(path, e))?;
        let track = Mp4Track::read(&mut file).map_err(|cause| DatasetError::video(path, cause))?;
        let shown = track.turn.size(track.height, track.width);
        if shown != (height, width) {
            let turned = if shown == (track.height, track.width) {
                ""
            } else {
                " after the turn that the file states (tkhd), by which LeRobot turns them"
            };
            return Err(DatasetError::video(
                path,
                format!(
                    "pictures are {} x {} (height x width){turned}, meta/info.json states {height} x {width}",
                    shown.0, shown.1
                ),
            ));
        }
        Ok(Self {
            path: path.into(),
            file,
            track,
        })
    }

    /// A sample's bytes; `Mp4Track` has checked that the file has them.
    pub fn sample(&mut self, at: usize) -> Result<Vec<u8>, DatasetError> {
        let sample = &self.track.samples[at];
        let mut bytes = vec![0; sample.size as usize];
        self.file
            .seek(SeekFrom::Start(sample.offset))
            .and_then(|_| self.file.read_exact(&mut bytes))
            .map_err(|e| DatasetError::io(&self.path, e))?;
        Ok(bytes)
    }

    pub fn key_before(&self, sample: usize) -> usize {
        let upto = &self.track.samples[..=sample];
        upto.iter().rposition(|s| s.key).unwrap_or(0)
    }

    /// What the first parameter set declares; AV1 has none.
    pub fn kind(&mut self) -> Result<Option<PictureKind>, DatasetError> {
        let (height, width) = (self.track.height, self.track.width);
        let (config, is_set): (NalConfig, fn(&[u8]) -> bool) = match &self.track.codec {
            Mp4Codec::Av1 => return Ok(None),
            Mp4Codec::H264(config) => (config.clone(), h264::units::is_sequence_parameters),
            Mp4Codec::Hevc(config) => (config.clone(), hevc::units::is_sequence_parameters),
        };
        let first = self.sample(0)?;
        let sets = config.parameter_sets.iter().map(Vec::as_slice);
        let in_band = Units::new(&config, &first).map_while(Result::ok);
        let kind = match sets.chain(in_band).find(|unit| is_set(unit)) {
            None => {
                Err("does not decode, as in a damaged file: no parameter set comes first".into())
            }
            Some(set) => match self.track.codec {
                Mp4Codec::Hevc(_) => hevc::sps::kind(set, height, width),
                _ => h264::sps::kind(set, height, width, self.track.colors),
            },
        };
        kind.map(Some).map_err(|e| self.fault(0, e))
    }

    pub fn fault(&self, frame: usize, cause: String) -> DatasetError {
        DatasetError::video(&self.path, format!("video frame {frame} {cause}"))
    }
}
