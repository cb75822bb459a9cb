//! FedAdam keeps moments from round to round, in a file that is read and written while the result is made.

use crate::made::{self, OneTensor, FED_ADAM};
use safetensors::{Dtype, SafeTensors};
use std::io::sink;
use std::sync::atomic::{AtomicUsize, Ordering};
use zk0_circuits::model::spec::Dims;
use zk0_circuits::{Digest, EvalSpec, NodeId, QuantisedWeights};
use zk0_protocol::rules::closing::server_moments::ServerMoments;
use zk0_protocol::rules::network_rules::Strategy;
use zk0_verifier::blob_digest;
use zk0_verifier::combine::bases::Bases;
use zk0_verifier::combine::blocks::Combination;
use zk0_verifier::combine::contributions::WeightedContribution;
use zk0_verifier::combine::error::CombineError;
use zk0_verifier::combine::optimizers::adam::{adam, AdamParameters};
use zk0_verifier::combine::optimizers::moments::{Moment, Moments};
use zk0_verifier::combine::source::{Block, BlockBuffer, WeightsInMemory};
use zk0_verifier::combine::strategy::{combined, AggregationResult};
use zk0_weights::{Format, ScaledTensor, Unread};

/// A network, the base of a round, and three updates.
struct Setting {
    format: Format,
    bases: Bases,
    unread: Unread,
    updates: Vec<QuantisedWeights>,
}

fn setting(spec: &EvalSpec) -> Setting {
    let format = made::format(spec);
    let weights = |seed: u32| {
        let tensors = made::tensors(spec, seed, 1.0 + seed as f32);
        made::quantise(spec, &tensors)
    };
    let base = format.write(&weights(0));
    Setting {
        unread: Unread::of(&format, &format.open(&base[..]).unwrap()).unwrap(),
        bases: Bases {
            base: Some(weights(0)),
            earlier: None,
        },
        updates: (1..4).map(weights).collect(),
        format,
    }
}

/// A file of moments that a round has kept.
struct Kept {
    file: Vec<u8>,
    moments: ServerMoments,
}

impl Kept {
    fn read_at(&self, blob: &Digest, place: u64, buffer: &mut [u8]) -> Result<(), String> {
        assert_eq!(*blob, self.moments.blob);
        let bytes = self.file.get(place as usize..).ok_or("it is too short")?;
        let bytes = bytes.get(..buffer.len()).ok_or("it is too short")?;
        buffer.copy_from_slice(bytes);
        Ok(())
    }
}

impl Setting {
    /// The round, whose updates are given in this order.
    fn combine(
        &self,
        order: &[usize],
        moments: &mut Moments<'_>,
    ) -> Result<AggregationResult, CombineError> {
        let format = &self.format;
        let updates = self.updates.iter();
        let updates: Vec<_> = updates
            .map(|weights| WeightsInMemory { format, weights })
            .collect();
        let given = order.iter().map(|number| WeightedContribution {
            node: NodeId([*number as u8; 32]),
            weight: 3 + 7 * *number as u64,
            weights: &updates[*number],
        });
        let given: Vec<_> = given.collect();
        combined(format, &given, FED_ADAM, &self.bases, &self.unread, moments)
    }

    /// The round from these moments. Returns the new weights and the new moments.
    fn round(&self, order: &[usize], before: Option<&Kept>) -> (Vec<u8>, Kept) {
        let mut file = Vec::new();
        let read_at = |blob: &Digest, place, buffer: &mut [u8]| match before {
            Some(kept) => kept.read_at(blob, place, buffer),
            None => Err("there are none".into()),
        };
        let mut moments = match before {
            Some(kept) => Moments::from(kept.moments, &read_at, &mut file),
            None => Moments::afresh(&mut file),
        };
        let steps = moments.steps() + 1;
        let combined = self.combine(order, &mut moments).unwrap();
        let blob = combined.moments.unwrap();
        assert_eq!(blob, blob_digest(&file));
        let moments = ServerMoments { blob, steps };
        (combined.file.into_bytes(), Kept { file, moments })
    }

    /// Why the round cannot go on from moments whose file `read_at` reads.
    fn refused(
        &self,
        moments: ServerMoments,
        read_at: &dyn Fn(&Digest, u64, &mut [u8]) -> Result<(), String>,
    ) -> CombineError {
        let mut nowhere = sink();
        let mut moments = Moments::from(moments, read_at, &mut nowhere);
        self.combine(&[0, 1, 2], &mut moments).unwrap_err()
    }
}

#[test]
fn moments_have_the_bits_they_always_had() {
    // This is a test vector that was computed once. It changes with any change of the arithmetic, and so would all ledgers.
    let setting = setting(&EvalSpec::micro());
    let (mut found, mut before) = (String::new(), None);
    for _ in 0..3 {
        let (weights, kept) = setting.round(&[0, 1, 2], before.as_ref());
        found += &format!("{} {}\n", blob_digest(&weights), kept.moments.blob);
        before = Some(kept);
    }
    made::check_vector("moments", &found);
}

#[test]
fn neither_the_order_of_contributions_nor_the_number_of_threads_changes_the_moments() {
    let setting = setting(&EvalSpec::micro());
    let (first, kept) = setting.round(&[0, 1, 2], None);
    let (second, later) = setting.round(&[0, 1, 2], Some(&kept));
    assert!(first != second, "the moments count");
    for order in [[1, 0, 2], [2, 1, 0], [1, 2, 0]] {
        for threads in [1, 3] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
            let found = pool.build().unwrap().install(|| {
                let (turned, turned_kept) = setting.round(&order, None);
                assert!(turned == first && turned_kept.file == kept.file);
                setting.round(&order, Some(&kept))
            });
            assert!(found.0 == second && found.1.file == later.file);
        }
    }
}

/// Anybody can look into the file with the usual tools.
#[test]
fn moments_are_a_safetensors_file() {
    let setting = setting(&EvalSpec::micro());
    let (_, kept) = setting.round(&[0, 1, 2], None);
    let file = SafeTensors::deserialize(&kept.file).unwrap();
    let tensors = setting.format.tensors();
    assert_eq!(file.len(), tensors.len());
    let mut moved = 0;
    for tensor in tensors {
        let moments = file.tensor(&tensor.name).unwrap();
        let shape = [&tensor.shape[..], &[2]].concat();
        assert_eq!((moments.dtype(), moments.shape()), (Dtype::F32, &shape[..]));
        for [first, second] in bytemuck::pod_collect_to_vec::<u8, [f32; 2]>(moments.data()) {
            assert!(first.is_finite() && second.is_finite() && second >= 0.0);
            // After the first round, m² is (1 − β₁)²·Δ², and v is (1 − β₂)·Δ². Both parts are a hundredth here.
            assert!((first * first - second).abs() <= 1e-6 * second);
            moved += usize::from(first != 0.0);
        }
    }
    assert!(moved > 0);
}

/// The published size has 98 million weights, and their moments are 800 MB.
#[test]
fn a_part_of_the_moments_is_in_memory_at_a_time() {
    let setting = setting(&EvalSpec::new(Dims {
        expert_width: 240,
        expert_mlp: 600,
        layers: 12,
        ..Dims::MICRO
    }));
    let (_, kept) = setting.round(&[0, 1, 2], None);
    let most = AtomicUsize::new(0);
    let read_at = |blob: &Digest, place, buffer: &mut [u8]| {
        most.fetch_max(buffer.len(), Ordering::Relaxed);
        kept.read_at(blob, place, buffer)
    };
    let mut nowhere = sink();
    let mut moments = Moments::from(kept.moments, &read_at, &mut nowhere);
    setting.combine(&[0, 1, 2], &mut moments).unwrap();
    let (most, all) = (most.into_inner(), kept.file.len());
    // Two million weights at a time.
    assert!(most <= 16 << 20 && 2 * most < all, "{most} of {all} bytes");
}

#[test]
fn moments_that_the_ledger_does_not_name_are_not_taken() {
    let setting = setting(&EvalSpec::micro());
    let (_, kept) = setting.round(&[0, 1, 2], None);
    let last = kept.file.len() - 1;
    for changed in [0, last / 2, last] {
        let read_at = |blob: &Digest, place: u64, buffer: &mut [u8]| {
            kept.read_at(blob, place, buffer)?;
            if let Some(byte) = changed.checked_sub(place as usize) {
                if let Some(byte) = buffer.get_mut(byte) {
                    *byte ^= 1;
                }
            }
            Ok(())
        };
        match setting.refused(kept.moments, &read_at) {
            CombineError::OtherMoments { expected, .. } => assert_eq!(expected, kept.moments.blob),
            other => panic!("{other}"),
        }
    }
    // A file that ends too early, and one that nobody has.
    let blob = kept.moments.blob;
    let short = |read: &Digest, place: u64, buffer: &mut [u8]| match place as usize + buffer.len() {
        end if end > last => Err("it is too short".into()),
        _ => kept.read_at(read, place, buffer),
    };
    let error = "it is too short".to_owned();
    let expected = CombineError::MomentsUnreadable { blob, error };
    assert_eq!(setting.refused(kept.moments, &short), expected);
    // What cannot be written is an error, too.
    let mut full = &mut [0u8; 100][..];
    let mut moments = Moments::afresh(&mut full);
    let error = setting.combine(&[0, 1, 2], &mut moments).unwrap_err();
    assert!(
        matches!(error, CombineError::MomentsUnwritten(_)),
        "{error}"
    );
}

const PARAMETERS: AdamParameters = AdamParameters {
    server_rate_billionths: 250_000_000,
    beta1_bps: 8000,
    beta2_bps: 9500,
    tau_billionths: 10_000_000,
};

/// A block of one tensor at its own scale.
fn one(values: &[i16], bits: i16) -> OneTensor {
    OneTensor(ScaledTensor {
        values: values.to_vec(),
        bits,
    })
}

/// One round of a tensor: its new numbers.
fn stepped(
    updates: &[(u64, OneTensor)],
    base: &OneTensor,
    parameters: AdamParameters,
    moments: &mut [Moment],
    steps: u64,
) -> Vec<f64> {
    let given = (1..)
        .zip(updates)
        .map(|(node, (weight, weights))| WeightedContribution {
            node: NodeId([node; 32]),
            weight: *weight,
            weights,
        });
    let given: Vec<_> = given.collect();
    let round = adam(&given, base, parameters, steps).unwrap();
    let len = base.0.values.len();
    let block = Block {
        tensor: 0,
        number: 0,
        len,
    };
    let mut numbers = vec![0i128; len];
    let mut rows = BlockBuffer::default();
    round
        .combine(&block, &mut numbers, moments, &mut rows)
        .unwrap();
    let plan = round.plan(0);
    let unit = plan.unit.divisor as f64 * f64::from(1 << plan.unit.bits);
    assert!(numbers.iter().all(|one| one.unsigned_abs() <= plan.bound));
    numbers.iter().map(|one| *one as f64 / unit).collect()
}

/// Each step is that of the formula, which is computed here from real numbers and without any rounding in between.
#[test]
fn a_step_is_that_of_adam() {
    let base = [1000, -2000, 0, 5];
    let updates = [[1024, -2000, 7, -300], [1500, -2001, -7, 6]];
    let (weights, bits) = ([1, 3], 12);
    let unit = f64::from(1 << bits);
    let given = || {
        let pairs = weights.into_iter().zip(updates);
        let given: Vec<_> = pairs
            .map(|(weight, update)| (weight, one(&update, bits)))
            .collect();
        given
    };
    let mut moments = [Moment::default(); 4];
    let mut expected = [(0.0f64, 0.0f64); 4];
    for steps in 0..5u64 {
        let results = stepped(&given(), &one(&base, bits), PARAMETERS, &mut moments, steps);
        let exponent = steps as i32 + 2;
        let rate = 0.25 * (1.0 - 0.95f64.powi(exponent)).sqrt() / (1.0 - 0.8f64.powi(exponent));
        for (at, result) in results.iter().enumerate() {
            let start = f64::from(base[at]) / unit;
            let mean = (f64::from(updates[0][at]) + 3.0 * f64::from(updates[1][at])) / 4.0 / unit;
            let (m, v) = &mut expected[at];
            *m = 0.8 * *m + 0.2 * (mean - start);
            *v = 0.95 * *v + 0.05 * (mean - start).powi(2);
            let step = rate * *m / (v.sqrt() + 0.01);
            assert!(
                (result - (start + step)).abs() < 1e-7,
                "{result}, {start}, {step}"
            );
            assert!((f64::from(moments[at].first) - *m).abs() <= 1e-6 * m.abs());
            assert!((f64::from(moments[at].second) - *v).abs() <= 1e-6 * *v);
        }
    }
}

/// Nothing overflows, whatever the rules allow: neither where weights jump from one end to the other, nor where the moments are those that a
/// false ledger names.
#[test]
fn the_most_that_is_possible_gives_weights_that_are_possible() {
    let extreme = AdamParameters {
        server_rate_billionths: 1_000_000_000,
        beta1_bps: 0,
        beta2_bps: 9999,
        tau_billionths: 1,
    };
    let base = one(&[i16::MAX, -i16::MAX, 0, 1], 0);
    let updates = || vec![(u64::MAX, one(&[-i16::MAX, i16::MAX, 0, 2], 0))];
    let mut moments = [Moment::default(); 4];
    let found = stepped(&updates(), &base, extreme, &mut moments, u64::MAX);
    // √(1 − β₂) is a hundredth, so the step is a hundred times η.
    assert!((found[0] - 32667.0).abs() < 0.01, "{found:?}");
    assert_eq!(found[2], 0.0);
    let nonsense = [
        (f32::NAN, 1.0),
        (f32::MAX, 0.0),
        (1.0, f32::NAN),
        (1.0, -1.0),
    ];
    let mut moments = nonsense.map(|(first, second)| Moment { first, second });
    let slow = AdamParameters {
        beta1_bps: 9999,
        ..extreme
    };
    let found = stepped(&updates(), &base, slow, &mut moments, 0);
    assert!(found.iter().all(|one| one.abs() <= 100_000.0), "{found:?}");
    // A strategy without a correction that could divide by zero: with both betas 0 it goes by the sign alone.
    let sign = AdamParameters {
        beta2_bps: 0,
        ..extreme
    };
    let mut moments = [Moment::default(); 4];
    let found = stepped(&updates(), &base, sign, &mut moments, 0);
    assert!(
        (found[0] - 32766.0).abs() < 1e-6 && (found[3] - 2.0).abs() < 1e-6,
        "{found:?}"
    );
}

/// Only FedAdam has moments.
#[test]
fn other_strategies_keep_no_moments() {
    let setting = setting(&EvalSpec::micro());
    let (format, mut kept) = (&setting.format, Vec::new());
    let update = WeightsInMemory {
        format,
        weights: &setting.updates[0],
    };
    let given = [WeightedContribution {
        node: NodeId([1; 32]),
        weight: 1,
        weights: &update,
    }];
    let mut moments = Moments::afresh(&mut kept);
    let strategy = Strategy::FedAvg;
    let result = combined(
        format,
        &given,
        strategy,
        &setting.bases,
        &setting.unread,
        &mut moments,
    );
    assert_eq!(result.unwrap().moments, None);
    assert!(kept.is_empty());
}
