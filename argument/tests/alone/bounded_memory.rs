//! An argument is made of one sample after the other, so memory hardly grows with their number.

use std::borrow::Cow;
use std::cell::RefCell;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use zk0_argument::claim::{committed, make, Blind, ClaimSource};
use zk0_circuits::claim::private_input::Header;
use zk0_circuits::model::spec::Dims;
use zk0_circuits::{Digest, EvalSpec, Mode, PrivateInput, QuantisedWeights, Sample};
use zk0_testkit::allocations::{alone, held, peak};
use zk0_testkit::claims::honest;

/// Less than what is committed to of a sample takes, in bytes.
const BLIND: Blind = Blind::new([5; 32]);
const VALUES: usize = 1 << 19;

/// A private input whose samples are in files.
struct InFiles {
    input: PrivateInput,
    files: Vec<PathBuf>,
    /// What was allocated before each sample was read.
    held: RefCell<Vec<usize>>,
}

impl InFiles {
    fn new(mut input: PrivateInput, folder: &Path) -> Self {
        let nothing = input.openings[0].sample.clone();
        let openings = input.openings.iter_mut().enumerate();
        let files = openings.map(|(number, opening)| {
            let file = folder.join(number.to_string());
            fs::write(&file, opening.sample.as_bytes()).unwrap();
            opening.sample = nothing.clone();
            file
        });
        Self {
            files: files.collect(),
            input,
            held: RefCell::default(),
        }
    }
}

impl ClaimSource for InFiles {
    fn header(&self) -> &Header {
        self.input.header()
    }

    fn models(&self) -> [&QuantisedWeights; 2] {
        self.input.models()
    }

    fn places(&self) -> Vec<(u64, &[Digest])> {
        self.input.places()
    }

    fn sample(&self, position: usize) -> io::Result<Cow<'_, Sample>> {
        self.held.borrow_mut().push(held());
        let bytes = fs::read(&self.files[position])?;
        let sample = Sample::from_bytes(&self.header().spec.dims, &bytes);
        sample.map(Cow::Owned).map_err(io::Error::other)
    }
}

#[test]
fn memory_hardly_grows_with_the_samples() {
    let _alone = alone();
    let spec = EvalSpec::new(Dims {
        max_prefix: 49,
        ..Dims::MICRO
    });
    let measured = |samples: u32, in_files: bool| {
        let folder = tempfile::tempdir().unwrap();
        let node = honest(&spec, 2 * samples as usize, samples, 7)
            .succinct(|spec, sample| committed(Mode::Succinct, spec, sample, &BLIND).digest);
        let size = node.input.openings[0].sample.as_bytes().len();
        let input = InFiles::new(node.input, folder.path());
        let values = in_files.then_some(folder.path());
        let (made, most) = peak(|| make(&input, &BLIND, values, &mut |_| {}));
        made.unwrap();
        (most, size, input.held.take())
    };
    // Trees of commitments stay in memory, of 2 MiB a sample, and with a folder the committed values do not.
    let each = |in_files: bool| {
        let [few, many] = [4, 12].map(|samples| measured(samples, in_files).0);
        many.saturating_sub(few) / 8
    };
    let (in_files, in_memory) = (each(true), each(false));
    assert!(
        in_files < 5 << 19 && in_files + VALUES < in_memory,
        "{in_files} bytes for each sample; {in_memory} without files"
    );
    // The models are evaluated first, and nothing is left of a sample but what was drawn for it.
    let (_, size, held) = measured(12, true);
    assert_eq!(held.len(), 24);
    let each = held[11].saturating_sub(held[1]) / 10;
    assert!(each < size / 2, "{each} bytes; a sample has {size}");
}
