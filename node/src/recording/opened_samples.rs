//! A claim's private input, with samples that stay on disk until they are read.

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

/// All that is needed to prove a claim. The samples' files have been checked.
#[derive(Clone, Debug, PartialEq)]
pub struct OpenedSamples {
    pub(super) header: Header,
    pub(super) base: QuantisedWeights,
    pub(super) update: QuantisedWeights,
    /// In the order of the challenge.
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

    /// A file that was changed after its check gives a claim that does not hold.
    fn sample(&self, position: usize) -> io::Result<Cow<'_, Sample>> {
        self.read(position).map(|(sample, _)| Cow::Owned(sample))
    }

    fn kept(&self, position: usize) -> io::Result<Vec<u8>> {
        self.read(position).map(|(_, kept)| kept)
    }
}

impl OpenedSamples {
    fn read(&self, position: usize) -> io::Result<(Sample, Vec<u8>)> {
        let opening = self.openings.get(position);
        let OpenedSample { file, .. } = opening.ok_or(io::ErrorKind::NotFound)?;
        let at = |error| io::Error::other(format!("{}: {error}", file.display()));
        SampleFiles::read_file(&self.header.spec.dims, file).map_err(at)
    }
}
