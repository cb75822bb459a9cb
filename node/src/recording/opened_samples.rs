//! A claim's private input whose samples stay on disk until somebody reads them.

use super::sample_files::SampleFiles;
use std::borrow::Cow;
use std::io;
use std::path::PathBuf;
use zk0_argument::claim::ClaimSource;
use zk0_circuits::claim::private_input::Header;
use zk0_circuits::{Digest, QuantisedWeights, Sample};

/// A sample that a claim opens.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OpenedSample {
    /// Its index in the dataset.
    pub index: u64,
    /// Its inclusion path.
    pub path: Vec<Digest>,
    /// Its file.
    pub file: PathBuf,
}

/// All that is needed to prove a claim. Whoever made it has checked the samples' files.
#[derive(Clone, Debug, PartialEq)]
pub struct OpenedSamples {
    pub(super) header: Header,
    pub(super) base: QuantisedWeights,
    pub(super) update: QuantisedWeights,
    /// In the order the challenge draws them.
    pub(super) openings: Vec<OpenedSample>,
}

impl ClaimSource for OpenedSamples {
    fn header(&self) -> &Header {
        &self.header
    }

    fn models(&self) -> [&QuantisedWeights; 2] {
        [&self.base, &self.update]
    }

    fn places(&self) -> Vec<(u64, &[Digest])> {
        let openings = self.openings.iter();
        openings
            .map(|opening| (opening.index, &opening.path[..]))
            .collect()
    }

    /// Reads the file. A file that has changed since it was checked gives a claim that does not hold.
    fn sample(&self, position: usize) -> io::Result<Cow<'_, Sample>> {
        let opening = self.openings.get(position);
        let OpenedSample { file, .. } = opening.ok_or(io::ErrorKind::NotFound)?;
        let at = |reason: String| io::Error::other(format!("{}: {reason}", file.display()));
        let sample = SampleFiles::unchecked(&self.header.spec.dims, file);
        sample
            .map(Cow::Owned)
            .map_err(|error| at(error.to_string()))
    }
}
