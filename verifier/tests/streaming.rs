//! A combination reads its contributions from files, a block at a time and by several threads. It gives what it gives in memory, and it
//! takes no number that was not verified.

use crate::made::{self, STRATEGIES};
use std::sync::atomic::{AtomicUsize, Ordering};
use zk0_circuits::model::layout::MAX_WEIGHT_BITS;
use zk0_circuits::model::spec::Dims;
use zk0_circuits::{Digest, EvalSpec, NodeId, QuantisedWeights};
use zk0_protocol::rules::network_rules::Strategy;
use zk0_verifier::blob_digest;
use zk0_verifier::combine::bases::Bases;
use zk0_verifier::combine::contributions::WeightedContribution;
use zk0_verifier::combine::error::CombineError;
use zk0_verifier::combine::sealed::{Sealed, SealedFile};
use zk0_verifier::combine::source::{WeightSource, WeightsInMemory, BLOCK};
use zk0_weights::scale::{exact, narrowed};
use zk0_weights::{Format, Unread, WeightFileError};

/// An expert with a tensor of several blocks, the last of which is not full.
fn spec() -> EvalSpec {
    EvalSpec::new(Dims {
        expert_width: 240,
        expert_mlp: 600,
        layers: 1,
        self_attn_every: 1,
        ..Dims::MICRO
    })
}

struct Setting {
    format: Format,
    weights: Vec<QuantisedWeights>,
    files: Vec<(Digest, Vec<u8>)>,
    sealed: Vec<Sealed>,
    bases: Bases,
    unread: Unread,
}

fn setting() -> Setting {
    let (spec, format) = (spec(), made::format(&spec()));
    let longest = format.tensors().iter().map(|tensor| tensor.len()).max();
    assert!(longest > Some(2 * BLOCK), "{longest:?}");
    let weights = |seed: u32| {
        let tensors = made::tensors(&spec, seed, 1.0 + seed as f32);
        made::quantise(&spec, &tensors)
    };
    let updates: Vec<_> = (1..=5).map(weights).collect();
    let files = updates.iter().map(|one| format.write(one));
    let base = format.write(&weights(0));
    Setting {
        files: files.map(|file| (blob_digest(&file), file)).collect(),
        sealed: updates.iter().map(|one| Sealed::of(&format, one)).collect(),
        unread: Unread::of(&format, &format.open(&base[..]).unwrap()).unwrap(),
        bases: Bases {
            base: Some(weights(0)),
            earlier: Some(weights(6)),
        },
        weights: updates,
        format,
    }
}

fn given<'a>(weights: impl Iterator<Item = &'a dyn WeightSource>) -> Vec<WeightedContribution<'a>> {
    let given = (1..)
        .zip(weights)
        .map(|(node, weights)| WeightedContribution {
            node: NodeId([node; 32]),
            weight: 7 * u64::from(node) + 3,
            weights,
        });
    given.collect()
}

impl Setting {
    fn in_memory(&self, strategy: Strategy) -> Vec<u8> {
        let format = &self.format;
        let weights = self
            .weights
            .iter()
            .map(|weights| WeightsInMemory { format, weights });
        let weights: Vec<_> = weights.collect();
        let given = given(weights.iter().map(|one| one as &dyn WeightSource));
        made::combine(format, &given, strategy, &self.bases, &self.unread)
            .unwrap()
            .into_bytes()
    }

    /// From files that are read by `read_at`.
    fn of_read_files(
        &self,
        strategy: Strategy,
        read_at: &(impl Fn(&Digest, u64, &mut [u8]) -> Result<(), String> + Sync),
    ) -> Result<Vec<u8>, CombineError> {
        let pairs = self.files.iter().zip(&self.sealed);
        let files =
            pairs.map(|((blob, _), sealed)| SealedFile::new(&self.format, sealed, *blob, read_at));
        let files: Vec<_> = files.collect();
        let given = given(files.iter().map(|one| one as &dyn WeightSource));
        let file = made::combine(&self.format, &given, strategy, &self.bases, &self.unread)?;
        Ok(file.into_bytes())
    }

    fn read_at(&self, blob: &Digest, place: u64, buffer: &mut [u8]) -> Result<(), String> {
        let mut files = self.files.iter();
        let (_, file) = files.find(|(digest, _)| digest == blob).ok_or("none")?;
        let bytes = file.get(place as usize..).ok_or("it is too short")?;
        let bytes = bytes.get(..buffer.len()).ok_or("it is too short")?;
        buffer.copy_from_slice(bytes);
        Ok(())
    }
}

#[test]
fn files_combine_to_what_weights_in_memory_combine_to_by_any_number_of_threads() {
    let setting = setting();
    let most = AtomicUsize::new(0);
    let read_at = |blob: &Digest, place, buffer: &mut [u8]| {
        most.fetch_max(buffer.len(), Ordering::Relaxed);
        setting.read_at(blob, place, buffer)
    };
    for strategy in STRATEGIES {
        let expected = setting.in_memory(strategy);
        for threads in [1, 2, 7] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
            let found = pool
                .build()
                .unwrap()
                .install(|| setting.of_read_files(strategy, &read_at));
            assert!(
                found.unwrap() == expected,
                "{strategy:?}, {threads} threads"
            );
        }
        assert!(setting.format.read(&expected).is_ok());
    }
    assert_eq!(most.into_inner(), 2 * BLOCK, "no more is read at once");
}

#[test]
fn a_number_that_changed_after_the_verification_is_never_averaged() {
    let setting = setting();
    let (blob, file) = &setting.files[2];
    let values_from = setting.format.place(0).0;
    let last = file.len() as u64 - 1;
    for strategy in STRATEGIES {
        for changed in [values_from, values_from + last / 2, last] {
            let read_at = |read: &Digest, place, buffer: &mut [u8]| {
                setting.read_at(read, place, buffer)?;
                if let (true, Some(at)) = (read == blob, changed.checked_sub(place)) {
                    if let Some(byte) = buffer.get_mut(at as usize) {
                        *byte ^= 1;
                    }
                }
                Ok(())
            };
            match setting.of_read_files(strategy, &read_at) {
                Err(CombineError::Changed { blob: found, .. }) => assert_eq!(&found, blob),
                found => panic!("{strategy:?}: {:?}", found.map(|file| file.len())),
            }
        }
    }
    // Another update's file in its place is no better, although it was verified too.
    let other = setting.files[3].0;
    let read_at = |read: &Digest, place, buffer: &mut [u8]| {
        let read = if read == blob { &other } else { read };
        setting.read_at(read, place, buffer)
    };
    let found = setting.of_read_files(Strategy::FedAvg, &read_at);
    assert!(matches!(found, Err(CombineError::Changed { .. })));
}

#[test]
fn a_file_that_cannot_be_read_is_named() {
    let setting = setting();
    let (blob, file) = &setting.files[4];
    let length = file.len() as u64;
    let read_at = |read: &Digest, place: u64, buffer: &mut [u8]| match read == blob {
        true if place + buffer.len() as u64 == length => Err("the disk is broken".to_owned()),
        _ => setting.read_at(read, place, buffer),
    };
    let error = setting
        .of_read_files(Strategy::FedAvg, &read_at)
        .unwrap_err();
    let expected = CombineError::Unreadable {
        blob: *blob,
        error: "the disk is broken".into(),
    };
    assert_eq!(error, expected);
}

/// FedAvg as it was before it read files: every number in 128 bits, in units of 2^−24.
#[test]
fn fedavg_is_the_plain_sum_of_plain_integers() {
    let setting = setting();
    let format = &setting.format;
    let weight = |index: usize| 7 * (index as i128 + 1) + 3;
    let divisor: i128 = (0..setting.weights.len()).map(weight).sum();
    let expected = format.assemble(|tensor| {
        let mut sums = vec![0i128; format.tensors()[tensor].len()];
        for (index, update) in setting.weights.iter().enumerate() {
            let (values, bits) = format.tensor(update, tensor);
            for (sum, value) in sums.iter_mut().zip(values) {
                *sum += weight(index) * i128::from(exact(*value, bits));
            }
        }
        setting.unread.restore(tensor, &mut sums, divisor);
        Ok::<_, WeightFileError>(narrowed(&sums, divisor, format.limits()[tensor]))
    });
    let expected = format.write(&expected.unwrap());
    assert!(setting.in_memory(Strategy::FedAvg) == expected);
    assert_eq!(MAX_WEIGHT_BITS, 24);
}
