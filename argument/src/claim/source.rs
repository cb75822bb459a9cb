//! What a claim is made of. Its samples may be on disk: they are read one at a time.

use crate::expert::prover_values::Models;
use std::borrow::Cow;
use std::io;
use zk0_circuits::claim::private_input::{Header, Opening};
use zk0_circuits::{Digest, PrivateInput, Sample};

/// A private input, of which one sample needs to be in memory at a time.
pub trait ClaimSource {
    /// Specification, terms, and salt.
    fn header(&self) -> &Header;

    /// The base and the update.
    fn models(&self) -> Models<'_>;

    /// Of each opened sample its index in the dataset and its inclusion path, in the order the challenge draws them.
    fn places(&self) -> Vec<(u64, &[Digest])>;

    /// The sample of an opening.
    ///
    /// # Errors
    /// It cannot be read.
    fn sample(&self, position: usize) -> io::Result<Cow<'_, Sample>>;

    /// What is kept of its commitment ([`super::SampleCommitment::kept`]); nothing if it is not known.
    ///
    /// # Errors
    /// It cannot be read.
    fn kept(&self, _position: usize) -> io::Result<Vec<u8>> {
        Ok(vec![])
    }

    /// All of it in memory.
    ///
    /// # Errors
    /// A sample cannot be read.
    fn whole(&self) -> io::Result<Cow<'_, PrivateInput>> {
        let places = self.places().into_iter().enumerate();
        let openings = places.map(|(position, (index, path))| {
            Ok(Opening {
                index,
                sample: self.sample(position)?.into_owned(),
                path: path.to_vec(),
            })
        });
        let [base, update] = self.models().map(Clone::clone);
        Ok(Cow::Owned(PrivateInput {
            header: self.header().clone(),
            base,
            update,
            openings: openings.collect::<io::Result<_>>()?,
        }))
    }
}

impl ClaimSource for PrivateInput {
    fn header(&self) -> &Header {
        &self.header
    }

    fn models(&self) -> Models<'_> {
        [&self.base, &self.update]
    }

    fn places(&self) -> Vec<(u64, &[Digest])> {
        let openings = self.openings.iter();
        openings
            .map(|opening| (opening.index, &opening.path[..]))
            .collect()
    }

    fn sample(&self, position: usize) -> io::Result<Cow<'_, Sample>> {
        let opening = self.openings.get(position);
        let sample = opening.map(|opening| Cow::Borrowed(&opening.sample));
        sample.ok_or_else(|| io::ErrorKind::NotFound.into())
    }

    fn whole(&self) -> io::Result<Cow<'_, PrivateInput>> {
        Ok(Cow::Borrowed(self))
    }
}
