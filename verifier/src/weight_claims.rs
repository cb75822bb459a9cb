//! The verifier's half of mode `succinct`: a proof leaves claims about both sets of weights at random points, and the holder of
//! the files computes the values there.
//!
//! One tensor at a time is in memory. Two threads read the files; browsers have no threads, so there one follows the other.

use std::thread;
use zk0_argument::expert::evaluation::layers::Expert;
use zk0_argument::expert::published::{digest, Published};
use zk0_argument::expert::statement::{Statement, MOST_SAMPLES};
use zk0_argument::transcript::Refused;
use zk0_circuits::Digest;
use zk0_protocol::rules::network_rules::MAX_SUCCINCT_SAMPLES;
use zk0_protocol::{Refusal, RefusalCode};
use zk0_tensors::ReadAt;
use zk0_weights::{Format, WeightsFile};

// The rules allow as many samples as an argument can be about.
const _: () = assert!(MAX_SUCCINCT_SAMPLES as usize == MOST_SAMPLES);

/// A file's weights are not known.
struct Failed(Refusal);

impl From<Refused> for Failed {
    fn from(refused: Refused) -> Self {
        Self(RefusalCode::OtherModels.because(refused))
    }
}

/// Checks a proof's claims about the files `base` and `update`. `claimed` is the weights' digest in the proof, `claims` are the
/// words of the claims.
pub fn check_weight_claims<R: ReadAt + Send>(
    format: &Format,
    claimed: &Digest,
    claims: &[u8],
    base: R,
    update: R,
) -> Result<(), Refusal> {
    let other = || Refusal::from(RefusalCode::OtherWeightCheck { claimed: *claimed });
    let (words, rest) = claims.as_chunks::<8>();
    let words: Vec<u64> = words.iter().map(|word| u64::from_le_bytes(*word)).collect();
    let published = Published::from_words(&words).ok_or_else(other)?;
    if !rest.is_empty() {
        return Err(other());
    }
    let files = (open(format, base)?, open(format, update)?);
    let scales = [&files.0, &files.1].map(|file| file.scales().to_vec());
    if digest(&scales, &words) != *claimed {
        return Err(other());
    }
    let statement = Statement::of_weights(format.spec(), scales);
    let other_models = |refused| Failed::from(refused).0;
    statement.check_bounds().map_err(other_models)?;
    let expert = Expert::new(&statement);
    let sums = |model: usize, file: WeightsFile<'_, R>| {
        let tensor = |number| {
            let tensor = file.tensor(number);
            tensor.map(|tensor| tensor.values).map_err(malformed)
        };
        published.sums(&expert, model, format.tensors().len(), tensor)
    };
    let (base, update) = if cfg!(target_family = "wasm") {
        (sums(0, files.0), sums(1, files.1))
    } else {
        thread::scope(|threads| {
            let base = threads.spawn(|| sums(0, files.0));
            let update = sums(1, files.1);
            let panicked = |_| Err(malformed("the thread that reads the base weights panicked"));
            (base.join().unwrap_or_else(panicked), update)
        })
    };
    let sums = [base, update].map(|sums| sums.map_err(|Failed(refusal)| refusal));
    let [base, update] = sums;
    published
        .check(&expert, [&base?, &update?])
        .map_err(other_models)
}

fn malformed(error: impl ToString) -> Failed {
    Failed(RefusalCode::MalformedUpdate.because(error.to_string()))
}

fn open<R: ReadAt>(format: &Format, file: R) -> Result<WeightsFile<'_, R>, Refusal> {
    format.open(file).map_err(|error| malformed(error).0)
}
