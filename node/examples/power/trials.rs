//! Claims under many challenges, evaluated natively in the fixed point of a proof.

use std::error::Error;
use std::thread;
use zk0_circuits::claim::challenge::sample_indices;
use zk0_circuits::claim::t_test::{Pair, TTest};
use zk0_circuits::model::draw::draw;
use zk0_circuits::model::eval::{Evaluator, Overflow};
use zk0_circuits::model::sample::Sample;
use zk0_circuits::vm::digest::tagged_sha256;
use zk0_circuits::{Digest, EvalSpec, QuantisedWeights};
use zk0_smolvla::measure::fixed_point::quantise_weights;
use zk0_smolvla::ExpertWeights;

pub type Result<T> = std::result::Result<T, Box<dyn Error + Send + Sync>>;

/// One of so many samples is in the rare band.
pub const BAND: u64 = 64;
/// What the loss of an update that is terrible there is, in losses of the base.
const TERRIBLE: u64 = 100;

/// Base and update, in fixed point.
pub struct Models {
    quantised: [QuantisedWeights; 2],
    banded: bool,
}

impl Models {
    /// Where the update is `banded`, its loss in the band is not evaluated: it is set.
    pub fn new(
        spec: &EvalSpec,
        base: &ExpertWeights,
        update: &ExpertWeights,
        banded: bool,
    ) -> Result<Self> {
        let quantised = [
            quantise_weights(spec, base)?,
            quantise_weights(spec, update)?,
        ];
        Ok(Self { quantised, banded })
    }

    /// The squared errors on `samples` under one challenge.
    fn pairs(
        &self,
        evaluator: &Evaluator<'_>,
        samples: &[Sample],
        challenge: &Digest,
        count: u32,
    ) -> Result<Vec<Pair>> {
        let mut direct = [
            evaluator.direct(&self.quantised[0], Overflow::Refused)?,
            evaluator.direct(&self.quantised[1], Overflow::Refused)?,
        ];
        let indices = sample_indices(challenge, samples.len() as u64, count)?;
        let mut pairs = Vec::with_capacity(indices.len());
        for (position, index) in indices.into_iter().enumerate() {
            let draw = draw(evaluator.spec, challenge, position as u32, count);
            let mut error = [0; 2];
            for (which, direct) in direct.iter_mut().enumerate() {
                let sample = &samples[index as usize];
                error[which] = evaluator.loss(direct, sample, &draw)?.squared_error;
            }
            let [base, mut update] = error;
            if self.banded && index % BAND == 0 {
                update = TERRIBLE * base;
            }
            pairs.push(Pair { base, update });
        }
        Ok(pairs)
    }
}

/// Whether a loss sum of `after` is lower than `before` by at least `min_improvement_bps` basis points: what a claim would prove without a
/// statistical test.
fn is_lower(before: u64, after: u64, min_improvement_bps: u32) -> bool {
    let kept = 10_000u128.saturating_sub(min_improvement_bps as u128);
    after < before && after as u128 * 10_000 <= before as u128 * kept
}

/// How often a claim passes.
#[derive(Default)]
pub struct Share {
    /// The t-test.
    pub test: f64,
    /// The plain comparison of the two sums.
    pub comparison: f64,
}

/// How often a claim over `count` samples passes, over many challenges.
pub fn share_of_passes(
    spec: &EvalSpec,
    models: &[Models],
    samples: &[Sample],
    test: &TTest,
    count: u32,
    trials: u32,
) -> Result<Share> {
    let passes = over_trials(trials, |trial, challenge| {
        let evaluator = Evaluator::new(spec)?;
        let models = &models[trial as usize % models.len()];
        let pairs = models.pairs(&evaluator, samples, challenge, count)?;
        let sum = |of: fn(&Pair) -> u64| pairs.iter().map(of).sum();
        let compared = is_lower(
            sum(|pair| pair.base),
            sum(|pair| pair.update),
            test.min_improvement_bps,
        );
        Ok([test.passes(&pairs), compared])
    })?;
    let share = |which: usize| {
        let passed = passes.iter().filter(|passed| passed[which]).count();
        passed as f64 / f64::from(trials)
    };
    Ok(Share {
        test: share(0),
        comparison: share(1),
    })
}

/// The relative change of the loss, over all samples and many draws of each.
pub fn true_change(spec: &EvalSpec, models: &[Models], samples: &[Sample]) -> Result<f64> {
    let sums = over_trials(24, |trial, challenge| {
        let evaluator = Evaluator::new(spec)?;
        let models = &models[trial as usize % models.len()];
        let pairs = models.pairs(&evaluator, samples, challenge, samples.len() as u32)?;
        let sum = |of: fn(&Pair) -> u64| pairs.iter().map(of).sum::<u64>() as f64;
        Ok([sum(|pair| pair.base), sum(|pair| pair.update)])
    })?;
    let sum = |which: usize| sums.iter().map(|sums| sums[which]).sum::<f64>();
    Ok(sum(1) / sum(0) - 1.0)
}

/// Runs `trial` under `trials` challenges, on all cores.
fn over_trials<T: Send>(
    trials: u32,
    trial: impl Fn(u32, &Digest) -> Result<T> + Sync,
) -> Result<Vec<T>> {
    let threads = thread::available_parallelism().map_or(1, |count| count.get() as u32);
    let trial = &trial;
    let parts: Vec<Result<Vec<T>>> = thread::scope(|scope| {
        let running: Vec<_> = (0..threads)
            .map(|first| {
                scope.spawn(move || {
                    let own = (first..trials).step_by(threads as usize);
                    own.map(|number| trial(number, &challenge(number)))
                        .collect()
                })
            })
            .collect();
        let join = |running: thread::ScopedJoinHandle<'_, Result<Vec<T>>>| {
            running
                .join()
                .unwrap_or_else(|_| Err("a trial panicked".into()))
        };
        running.into_iter().map(join).collect()
    });
    parts
        .into_iter()
        .collect::<Result<Vec<_>>>()
        .map(|parts| parts.into_iter().flatten().collect())
}

fn challenge(number: u32) -> Digest {
    tagged_sha256("zk0/power", &[&number.to_le_bytes()])
}
