//! The samples of an evaluation set on disk, one file each.
//!
//! `FRAME-SAMPLE.sample`: FRAME is a hash of the node's secret and of the frame's name in prefix caches, and SAMPLE is the digest that the
//! node commits to. So a restarted node knows its samples by their names, and reads only those of a claim. Under another secret, it finds
//! no file.
//!
//! A file holds the sample, the part of its commitment that saves hashing it again, that part's length (a u64, little-endian), and the
//! SHA-256 of all of it, which each reading checks.

use crate::error::ParticipantError;
use crate::recording::secret::RegistrationSecret;
use crate::state_files::{self, broken};
use sha2::{Digest as _, Sha256};
use std::collections::HashMap;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use zk0_argument::claim::{committed, digest_of, SampleCommitment};
use zk0_circuits::model::sample::Sample;
use zk0_circuits::model::spec::Dims;
use zk0_circuits::{Digest, EvalSpec, Mode};
use zk0_smolvla::frames::prefix_cache::CacheKey;

/// Most bytes that are kept of a commitment.
const MOST_KEPT: u64 = 32 << 20;

/// A folder of samples.
pub struct SampleFiles {
    folder: PathBuf,
    mode: Mode,
    spec: EvalSpec,
    secret: RegistrationSecret,
    /// By FRAME, as of opening.
    known: HashMap<Digest, Digest>,
}

impl SampleFiles {
    /// Opens or makes `folder`, for samples of this evaluation, committed to as `mode` asks, under `secret`. Unfinished files of a killed
    /// process are removed.
    ///
    /// # Errors
    /// The folder cannot be made or read.
    pub fn open(
        folder: &Path,
        mode: Mode,
        spec: &EvalSpec,
        secret: &RegistrationSecret,
    ) -> Result<Self, ParticipantError> {
        fs::create_dir_all(folder).map_err(state_files::at(folder))?;
        state_files::remove_unfinished(folder)?;
        let mut known = HashMap::new();
        for file in fs::read_dir(folder).map_err(state_files::at(folder))? {
            let name = file.map_err(state_files::at(folder))?.file_name();
            if let Some((frame, digest)) = parsed(&name) {
                known.insert(frame, digest);
            }
        }
        Ok(Self {
            folder: folder.into(),
            mode,
            spec: spec.clone(),
            secret: secret.clone(),
            known,
        })
    }

    /// The digest of a frame's sample, if its file was there at opening.
    pub fn find(&self, key: &CacheKey) -> Option<Digest> {
        self.known.get(&self.secret.name(key)).copied()
    }

    /// Writes a sample to disk. Returns its digest.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn put(&self, key: &CacheKey, sample: &Sample) -> Result<Digest, ParticipantError> {
        let SampleCommitment { digest, kept } =
            committed(self.mode, &self.spec, sample, &self.secret.blind());
        let length = (kept.len() as u64).to_le_bytes();
        let mut bytes = [sample.as_bytes(), &kept, &length].concat();
        bytes.extend(Sha256::digest(&bytes));
        state_files::write(&self.path(key, &digest), &bytes)?;
        Ok(digest)
    }

    /// Reads a sample, and checks its digest.
    ///
    /// # Errors
    /// The file cannot be read. [`ParticipantError::BrokenFile`]: it is missing, or holds another sample.
    pub fn read(&self, key: &CacheKey, digest: &Digest) -> Result<Sample, ParticipantError> {
        let path = self.path(key, digest);
        let (sample, kept) = Self::read_file(&self.spec.dims, &path)?;
        match digest_of(self.mode, &self.spec, &sample, &kept) {
            found if found == *digest => Ok(sample),
            found => Err(broken(&path, format!("its digest is {found}"))),
        }
    }

    /// Reads a sample and the kept part of its commitment, without a check of which sample it is.
    ///
    /// # Errors
    /// The file cannot be read. [`ParticipantError::BrokenFile`]: it is missing or damaged.
    pub fn read_file(dims: &Dims, path: &Path) -> Result<(Sample, Vec<u8>), ParticipantError> {
        let most = Sample::byte_len(dims, dims.max_prefix as usize) as u64 + MOST_KEPT;
        let bytes = state_files::read(path, most)?
            .ok_or_else(|| broken(path, "it is not there any more".into()))?;
        let early = || broken(path, "it ends too early".into());
        let (rest, sha256) = bytes.split_last_chunk::<32>().ok_or_else(early)?;
        if Sha256::digest(rest)[..] != sha256[..] {
            return Err(broken(path, "its SHA-256 is not the one at its end".into()));
        }
        let (rest, length) = rest.split_last_chunk::<8>().ok_or_else(early)?;
        let length = usize::try_from(u64::from_le_bytes(*length)).unwrap_or(usize::MAX);
        let sample = rest.len().checked_sub(length).ok_or_else(early)?;
        let (sample, kept) = rest.split_at(sample);
        let sample = Sample::from_bytes(dims, sample);
        let sample = sample.map_err(|error| broken(path, error.to_string()))?;
        Ok((sample, kept.to_vec()))
    }

    /// The file of a sample.
    pub fn path(&self, key: &CacheKey, digest: &Digest) -> PathBuf {
        let frame = self.secret.name(key);
        self.folder.join(format!("{frame}-{digest}.sample"))
    }
}

fn parsed(name: &OsStr) -> Option<(Digest, Digest)> {
    let (frame, digest) = name.to_str()?.strip_suffix(".sample")?.split_once('-')?;
    Some((frame.parse().ok()?, digest.parse().ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use zk0_circuits::model::sample::SampleParts;

    const KEY: CacheKey = CacheKey([7; 32]);

    fn open(folder: &Path) -> SampleFiles {
        open_under(folder, &RegistrationSecret::new([1; 32]))
    }

    fn open_under(folder: &Path, secret: &RegistrationSecret) -> SampleFiles {
        SampleFiles::open(folder, Mode::Direct, &EvalSpec::micro(), secret).unwrap()
    }

    fn sample(value: f32) -> Sample {
        let dims = Dims::MICRO;
        let cache = vec![value; 3 * dims.kv_width()];
        let layers = vec![(&cache[..], &cache[..]); dims.layers as usize];
        let actions = vec![0.5; (dims.chunk * dims.max_action_dim) as usize];
        let parts = SampleParts {
            cache: &layers,
            actions: &actions,
            is_pad: &vec![false; dims.chunk as usize],
        };
        Sample::quantise(&EvalSpec::micro(), parts).unwrap()
    }

    #[test]
    fn a_sample_comes_back_and_its_name_tells_its_digest() {
        let dir = tempfile::tempdir().unwrap();
        let files = open(dir.path());
        assert_eq!(files.find(&KEY), None);
        let digest = files.put(&KEY, &sample(0.25)).unwrap();
        assert_eq!(digest, sample(0.25).digest());
        fs::write(dir.path().join("half.sample.1-0.unfinished"), b"half").unwrap();
        fs::write(dir.path().join("notes.txt"), b"of the operator").unwrap();

        let again = open(dir.path());
        assert_eq!(again.find(&KEY), Some(digest));
        assert_eq!(again.find(&CacheKey([8; 32])), None);
        let other = open_under(dir.path(), &RegistrationSecret::new([2; 32]));
        assert_eq!(other.find(&KEY), None, "found under another secret");
        assert_eq!(again.read(&KEY, &digest).unwrap(), sample(0.25));
        assert_eq!(
            fs::read_dir(dir.path()).unwrap().count(),
            2,
            "what was unfinished is removed, and the operator's file stays"
        );
    }

    #[test]
    fn a_damaged_or_lost_file_is_an_error_that_names_it() {
        let dir = tempfile::tempdir().unwrap();
        let files = open(dir.path());
        let digest = files.put(&KEY, &sample(0.25)).unwrap();
        let path = files.path(&KEY, &digest);
        let good = fs::read(&path).unwrap();
        let mut flipped = good.clone();
        let in_the_cache = flipped.len() - 56;
        flipped[in_the_cache] ^= 1;
        let longer = vec![0; MOST_KEPT as usize + (1 << 20)];
        let other = files.put(&CacheKey([8; 32]), &sample(0.5)).unwrap();
        let other = fs::read(files.path(&CacheKey([8; 32]), &other)).unwrap();
        // No sample, but a SHA-256 that fits
        let of = |bytes: &[u8]| [bytes, &Sha256::digest(bytes)[..]].concat();
        for (bytes, why) in [
            (&flipped, "SHA-256"),
            (&other, "its digest is"),
            (&good[..40].to_vec(), "SHA-256"),
            (&Vec::new(), "too early"),
            (&of(&[7; 6]), "too early"),
            (&of(&[255; 8]), "too early"),
            (&of(&[0; 40]), "prefix tokens"),
            (&longer, "more than"),
        ] {
            fs::write(&path, bytes).unwrap();
            let error = files.read(&KEY, &digest).unwrap_err();
            let reported = error.to_string();
            assert!(
                reported.contains(why) && reported.contains("-"),
                "{reported}"
            );
            assert!(reported.contains(".sample is not what this node wrote there"));
        }
        fs::remove_file(&path).unwrap();
        let error = files.read(&KEY, &digest).unwrap_err();
        assert!(error.to_string().contains("not there any more"), "{error}");
    }
}
