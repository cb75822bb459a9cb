//! Frames of one mp4 file by time: decoded once when asked for in order, from the nearest key frame otherwise.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use super::av1::Av1;
use super::mp4::{Mp4Sample, Mp4Track};
use super::DatasetError;

/// An open video; holds its index (about 32 bytes a frame) and one decoder, not its content.
pub struct VideoReader {
    path: PathBuf,
    file: File,
    track: Mp4Track,
    /// A decoder that has been fed everything from some key frame up to, not including, this sample.
    decoder: Option<(Av1, usize)>,
}

impl VideoReader {
    /// Opens an mp4 whose pictures are `height x width`.
    ///
    /// # Errors
    /// Missing, cut off, not an mp4, not AV1, or of another size; the path and what is wrong.
    pub fn open(path: &Path, height: usize, width: usize) -> Result<Self, DatasetError> {
        let mut file = File::open(path).map_err(|e| DatasetError::io(path, e))?;
        let track = Mp4Track::read(&mut file).map_err(|cause| DatasetError::video(path, cause))?;
        if (track.height, track.width) != (height, width) {
            return Err(DatasetError::video(
                path,
                format!(
                    "pictures are {} x {} (height x width), meta/info.json says {height} x {width}",
                    track.height, track.width
                ),
            ));
        }
        Ok(Self {
            path: path.into(),
            file,
            track,
            decoder: None,
        })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Number of frames.
    pub fn len(&self) -> usize {
        self.track.samples.len()
    }

    /// Whether there are no frames; [`VideoReader::open`] refuses such a file, so this is `false`.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Number of the frame shown at `seconds`, give or take `tolerance` seconds.
    ///
    /// # Errors
    /// No frame is shown at that time.
    pub fn frame_at(&self, seconds: f64, tolerance: f64) -> Result<usize, DatasetError> {
        let samples = &self.track.samples;
        let after = samples.partition_point(|s| s.time < seconds);
        let distance = |i: &usize| samples.get(*i).map(|s| (s.time - seconds).abs());
        [after.saturating_sub(1), after]
            .into_iter()
            .filter(|i| distance(i).is_some_and(|d| d <= tolerance))
            .min_by(|a, b| distance(a).partial_cmp(&distance(b)).unwrap_or(std::cmp::Ordering::Equal))
            .ok_or_else(|| {
                let last = samples.last().map_or(0.0, |s| s.time);
                DatasetError::video(
                    &self.path,
                    format!(
                        "shows no frame at {seconds:.6} s (within {tolerance} s); its {} frames end at {last:.6} s",
                        samples.len()
                    ),
                )
            })
    }

    /// RGB of frame `number`, `[3, height, width]`; asking in ascending order decodes every frame once.
    ///
    /// # Errors
    /// There is no such frame, or it or one it depends on does not decode.
    pub fn rgb(&mut self, number: usize) -> Result<Vec<u8>, DatasetError> {
        let fault = |path: &Path, n: usize, e: String| {
            DatasetError::video(path, format!("video frame {n} {e}"))
        };
        let Some(upto) = self.track.samples.get(..=number) else {
            return Err(fault(
                &self.path,
                number,
                format!("does not exist, there are {}", self.len()),
            ));
        };
        let key = upto.iter().rposition(|s| s.key).unwrap_or(0);
        // Taken out, so that a decoder that failed is not used again.
        let (mut decoder, start) = match self.decoder.take() {
            Some((decoder, next)) if (key..=number).contains(&next) => (decoder, next),
            _ => {
                let decoder = Av1::new(self.track.height, self.track.width)
                    .map_err(|e| DatasetError::video(&self.path, e))?;
                (decoder, key)
            }
        };
        for at in start..number {
            let encoded = read_sample(&mut self.file, &self.path, &self.track.samples[at])?;
            decoder
                .decode(encoded)
                .map_err(|e| fault(&self.path, at, e))?;
        }
        let encoded = read_sample(&mut self.file, &self.path, &self.track.samples[number])?;
        let rgb = decoder
            .decode(encoded)
            .and_then(|picture| picture.to_rgb())
            .map_err(|e| fault(&self.path, number, e))?;
        self.decoder = Some((decoder, number + 1));
        Ok(rgb)
    }
}

/// One encoded frame's bytes; `Mp4Track` has checked that they lie within the file.
fn read_sample(file: &mut File, path: &Path, sample: &Mp4Sample) -> Result<Vec<u8>, DatasetError> {
    let mut bytes = vec![0; sample.size as usize];
    file.seek(SeekFrom::Start(sample.offset))
        .and_then(|_| file.read_exact(&mut bytes))
        .map_err(|e| DatasetError::io(path, e))?;
    Ok(bytes)
}
