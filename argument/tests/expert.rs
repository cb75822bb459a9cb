//! The expert's argument: what the evaluation computes is accepted, and what is changed is refused.

use crate::models::{Models, BLIND};
use std::io;
use zk0_argument::expert::argument::{prove::prove, verify, Verified};
use zk0_argument::expert::builder::MAIN;
use zk0_argument::expert::evaluation::layers::Expert;
use zk0_argument::expert::prover_values::{evaluate, Common, SampleValues};
use zk0_argument::expert::published::{digest as digest_of_words, Published};
use zk0_argument::expert::sample;
use zk0_argument::expert::sizes::{P, X};
use zk0_argument::expert::statement::Statement;
use zk0_argument::field::Goldilocks;
use zk0_argument::prove::progress::silently;
use zk0_argument::prove::{check, check_equalities, Computed, Tables, Violation};
use zk0_argument::relation::{Relations, Tensor};
use zk0_argument::transcript::Refused;
use zk0_circuits::model::layout::Layout;
use zk0_circuits::{Digest, EvalSpec, QuantisedWeights, Sample};
use zk0_testkit::claims::Random;

/// What attention scores are compared by.
const DISTANCE: &str = "distance to the largest score";
/// Results that are added to what the layer before has.
const RESIDUALS: [&str; 2] = ["attention out", "down"];

/// What the statements are about.
const CONTEXT: Digest = Digest([7; 32]);

/// A statement, and all values behind it.
struct Made {
    models: [QuantisedWeights; 2],
    statement: Statement,
    expert: Expert,
    common: Common,
    witnesses: Vec<SampleValues>,
}

impl Made {
    fn new(models: &Models) -> Self {
        let weights = [&models.base, &models.update];
        let statement =
            evaluate(CONTEXT, &models.spec, weights, &models.samples, &silently).unwrap();
        let expert = Expert::new(&statement);
        let common = Common::new(&statement, weights);
        let sample_values = |number| {
            SampleValues::of(&statement, &common, number, weights, &models.samples).unwrap()
        };
        let witnesses = (0..models.samples.len()).map(sample_values).collect();
        Self {
            models: weights.map(Clone::clone),
            statement,
            expert,
            common,
            witnesses,
        }
    }

    fn relations(&self) -> &Relations {
        &self.expert.builder.relations
    }

    fn check(&self) -> Result<(), Violation> {
        self.witnesses.iter().try_for_each(|sample_values| {
            check(&Tables {
                relations: &sample_values.expert.builder.relations,
                sources: &sample_values.sources(&self.common),
                computed: &Computed::default(),
            })
        })
    }

    fn check_equalities(&self) -> Result<(), Violation> {
        self.witnesses.iter().try_for_each(|sample_values| {
            check_equalities(&Tables {
                relations: &sample_values.expert.builder.relations,
                sources: &sample_values.sources(&self.common),
                computed: &Computed::default(),
            })
        })
    }

    fn proof(&self) -> Vec<u64> {
        let sample_values = |number: usize| Ok::<_, io::Error>(self.witnesses[number].clone());
        let folder = std::env::temp_dir();
        let proof = prove(
            &self.statement,
            &self.common,
            &BLIND,
            Some(&folder),
            &silently,
            sample_values,
        );
        proof.unwrap()
    }

    /// Verifies, and checks what is left with the weights.
    fn verify(&self, statement: &Statement, proof: &[u64]) -> Result<Verified, Refused> {
        let verified = verify(statement, proof)?;
        self.holds(&verified.published)?;
        Ok(verified)
    }

    fn holds(&self, published: &Published) -> Result<(), Refused> {
        let layout = Layout::new(&self.statement.spec.dims);
        let sums = |model: usize| {
            let tensor = |number| Ok::<_, Refused>(self.models[model].tensor(&layout, number).0);
            published.sums(&self.expert, model, layout.tensors.len(), tensor)
        };
        published.check(&self.expert, [&sums(0)?, &sums(1)?])
    }
}

#[test]
fn an_evaluation_is_accepted() {
    for samples in [1, 2, 3] {
        let made = Made::new(&Models::new(&EvalSpec::micro(), samples, samples as u64));
        assert_eq!(made.check(), Ok(()));
        made.verify(&made.statement, &made.proof()).unwrap();
    }
    let made = Made::new(&Models::loud(&EvalSpec::micro(), 2, 5));
    assert!(made.statement.saturates);
    made.verify(&made.statement, &made.proof()).unwrap();
}

/// More is committed to than need be.
#[test]
fn a_statement_may_saturate_without_need() {
    let mut made = Made::new(&Models::new(&EvalSpec::micro(), 1, 6));
    let plain = made.statement.clone();
    let proof = made.proof();
    made.statement.saturates = true;
    assert!(made.verify(&made.statement, &proof).is_err());
    assert_ne!(plain.digest(), made.statement.digest());
}

/// Tensors whose values saturate, with what exceeds one of their limits.
struct Saturating {
    name: &'static str,
    /// 1 above the limit, and -1 below it.
    sign: i64,
    limit: i64,
    result: Tensor,
    excess: Tensor,
}

impl Saturating {
    fn all(made: &Made) -> Vec<Self> {
        let relations = made.relations();
        let names = ["query", "attention out", "gate", "up", "gated MLP", "down"];
        let int16 = [(1, i16::MAX.into()), (-1, i16::MIN.into())];
        let furthest = [(1, made.expert.builder.sizes.count(X) as i64 - 1)];
        let limits = names.map(|name| (name, &int16[..]));
        let distances = [(DISTANCE, &furthest[..])];
        let all = limits.into_iter().chain(distances);
        all.flat_map(|(name, limits)| {
            let of_main = |tensor: &&Tensor| tensor.name == name && tensor.source == MAIN;
            let own: Vec<_> = relations.tensors.iter().filter(of_main).collect();
            let limits = limits.iter().zip(own.clone().into_iter().skip(1));
            let saturating = limits.map(|(&(sign, limit), excess)| Self {
                name,
                sign,
                limit,
                result: own[0].clone(),
                excess: excess.clone(),
            });
            saturating.collect::<Vec<_>>()
        })
        .collect()
    }

    /// The first place of a result and of its excess that is such a one.
    fn find(&self, main: &[i64], is: impl Fn(i64, i64) -> bool) -> Option<[usize; 2]> {
        let places = &self.excess.places;
        let size: u32 = places.iter().map(|place| place.bits as u32).sum();
        let indices = (0..1usize << size).map(|mut number| {
            let digits = places.iter().map(|place| {
                let digit = number & ((1 << place.bits) - 1);
                number >>= place.bits;
                digit
            });
            digits.collect::<Vec<_>>()
        });
        let mut values = indices.map(|at| [self.result.number(&at), self.excess.number(&at)]);
        values.find(|&[result, excess]| is(main[result], main[excess]))
    }
}

/// What exceeds a limit does so where the result is the limit.
#[test]
fn a_base_saturates_at_the_limits_alone() {
    let mut made = Made::new(&Models::loud(&EvalSpec::micro(), 1, 5));
    let mut tried = vec![];
    for tensor in Saturating::all(&made) {
        let exceeds = tensor.find(&made.witnesses[0].main, |_, excess| excess > 0);
        let Some([result, excess]) = exceeds else {
            continue;
        };
        // The sum of both is the same as before.
        let change = |made: &mut Made, by: i64| {
            let main = &mut made.witnesses[0].main;
            main[excess] += by;
            main[result] -= tensor.sign * by;
        };
        assert_eq!(made.check_equalities(), Ok(()));
        change(&mut made, 1);
        assert!(made.check_equalities().is_err(), "{}", tensor.name);
        change(&mut made, -1);
        tried.push((tensor.name, tensor.sign));
    }
    let of = |sign| tried.iter().any(|&(_, own)| own == sign);
    assert!(
        of(1) && of(-1) && tried.contains(&(DISTANCE, 1)),
        "{tried:?}"
    );
}

/// A result within its limits is not raised to one by an excess below zero. (The results left out have relations that come before their own.)
#[test]
fn nothing_exceeds_a_limit_by_less_than_zero() {
    let mut made = Made::new(&Models::loud(&EvalSpec::micro(), 1, 5));
    let mut tried = 0;
    for tensor in Saturating::all(&made) {
        let Saturating { sign, limit, .. } = tensor;
        let within = |result: i64, _| result != 0 && sign * result < sign * limit;
        let found = tensor.find(&made.witnesses[0].main, within);
        let Some([result, excess]) = found.filter(|_| !RESIDUALS.contains(&tensor.name)) else {
            continue;
        };
        let main = &mut made.witnesses[0].main;
        let before = main[result];
        (main[result], main[excess]) = (limit, sign * (before - limit));
        match made.check() {
            Err(Violation::NotInTable(refused)) => assert_eq!(refused.lookup, tensor.name),
            other => panic!("{}: {other:?}", tensor.name),
        }
        let main = &mut made.witnesses[0].main;
        (main[result], main[excess]) = (before, 0);
        tried += 1;
    }
    assert_eq!(tried, 9);
}

/// One value of each committed tensor is changed. Some relation names it.
#[test]
fn a_changed_value_breaks_a_relation() {
    for models in [Models::new, Models::loud] {
        each_value_counts(Made::new(&models(&EvalSpec::micro(), 2, 4)));
    }
}

fn each_value_counts(mut made: Made) {
    let mut random = Random(4);
    let tensors = made.witnesses[0].expert.builder.relations.tensors.clone();
    for tensor in tensors.iter().filter(|tensor| tensor.source == MAIN) {
        // Token 0 counts in every sample, and every token sees the one in the middle of all that is attended to.
        let index = tensor.places.iter().skip(1);
        let number = index.fold(tensor.offset, |number, place| {
            let middle = 1usize << place.bits >> 1;
            let first = place.bits != made.expert.builder.sizes.of(P) && random.bits() & 1 == 0;
            number + (if first { 0 } else { middle } << place.shift)
        });
        let sample_values = random.bits() as usize % 2;
        made.witnesses[sample_values].main[number] += 1;
        assert!(made.check().is_err(), "value {number} of {}", tensor.name);
        made.witnesses[sample_values].main[number] -= 1;
    }
    assert_eq!(made.check(), Ok(()));
}

/// Where the evaluation reads nothing, a sample holds zeros: beyond its frames and its prefix.
#[test]
fn a_sample_holds_nothing_that_is_not_read() {
    let mut made = Made::new(&Models::new(&EvalSpec::micro(), 3, 8));
    let tensors = made.relations().tensors.clone();
    let dims = made.statement.spec.dims;
    let [actions, keys, values] = {
        let sample = &made.expert.sample;
        [sample.actions, sample.keys, sample.values].map(|tensor| &tensors[tensor.tensor])
    };
    let short = &made.statement.samples[1];
    assert!(short.frames < dims.chunk as usize && short.prefix < dims.max_prefix as usize);
    let unread = [
        actions.number(&[short.frames, 0, 0]),
        keys.number(&[short.prefix, 0, 0, 0, 0]),
        values.number(&[short.prefix, 0, 0, 0, 0]),
    ];
    // Layer 0 is one of self-attention: it projects nothing of the prefix. The cheat counts right that it looks up 1 in place of 0, both 2^15 more, among the values of 16 bits.
    let ranges = tensors
        .iter()
        .find(|tensor| tensor.name == "ranges")
        .unwrap();
    let [zero, one] = [0, 1].map(|value| ranges.number(&[(1 << 16) + (1 << 15) + value, 0]));
    for number in unread {
        let own = &mut made.witnesses[1];
        assert_eq!(own.data[number], 0);
        own.data[number] = 1;
        own.main[zero] -= 1;
        own.main[one] += 1;
        let violation = made.check().unwrap_err().to_string();
        assert!(violation.contains("where nothing is read"), "{violation}");
        let refused = made.verify(&made.statement, &made.proof()).err();
        let expected = Refused::Equation("the sumcheck of an argument's end");
        assert_eq!(refused, Some(expected), "value {number} of the samples");
        let own = &mut made.witnesses[1];
        own.data[number] = 0;
        own.main[zero] += 1;
        own.main[one] -= 1;
    }
    // An action dimension beyond those of the robot has noise alone, with which the evaluation calculates.
    let unused = actions.number(&[0, dims.action_dim as usize, 0]);
    made.witnesses[1].data[unused] = 1;
    assert!(made.check().is_err());
    made.witnesses[1].data[unused] = 0;
    assert_eq!(made.check(), Ok(()));
}

/// A node commits to a sample before there are weights. The proof is about that sample.
#[test]
fn a_proof_names_the_samples_as_they_were_committed_to() {
    let models = Models::new(&EvalSpec::micro(), 3, 9);
    let made = Made::new(&models);
    let verified = made.verify(&made.statement, &made.proof()).unwrap();
    let digest = |sample: &Sample| sample::prove::committed(&models.spec, sample, &BLIND).0;
    let expected: Vec<_> = models
        .samples
        .iter()
        .map(|(sample, _)| digest(sample))
        .collect();
    assert_eq!(verified.samples, expected);
    assert!(expected[0] != expected[1] && expected[1] != expected[2] && expected[0] != expected[2]);
}

/// Something changes in a statement.
type Change = fn(&mut Statement);

#[test]
fn a_changed_statement_is_refused() {
    let made = Made::new(&Models::new(&EvalSpec::micro(), 2, 5));
    let proof = made.proof();
    made.verify(&made.statement, &proof).unwrap();
    let changes: [(&str, Change); 11] = [
        ("loss", |s| s.samples[0].losses[0] += 1),
        ("losses swapped", |s| s.samples[1].losses.reverse()),
        ("samples swapped", |s| s.samples.reverse()),
        ("frames", |s| s.samples[0].frames -= 1),
        ("prefix", |s| s.samples[1].prefix += 1),
        ("noise", |s| s.samples[1].draw.noise[3] += 1),
        ("time", |s| s.samples[0].draw.time ^= 1),
        ("context", |s| s.context.0[31] ^= 1),
        ("scale", |s| s.scales[1][8] -= 1),
        ("scale of a bias", |s| s.scales[0][1] -= 1),
        ("specification", |s| s.spec.layers[0].query -= 1),
    ];
    for (what, change) in changes {
        let mut statement = made.statement.clone();
        change(&mut statement);
        assert!(made.verify(&statement, &proof).is_err(), "{what}");
    }
}

#[test]
fn a_changed_word_is_refused() {
    let made = Made::new(&Models::new(&EvalSpec::micro(), 1, 6));
    let proof = made.proof();
    let mut random = Random(6);
    for _ in 0..150 {
        // Half of the words that are tried are before the openings, which are most of the proof.
        let among = proof.len() >> ((random.bits() & 1) * 4);
        let word = random.bits() as usize % among;
        let mut changed = proof.clone();
        changed[word] ^= 1;
        assert!(
            made.verify(&made.statement, &changed).is_err(),
            "word {word} of {}",
            proof.len()
        );
    }
    for wrong in [&proof[1..], &proof[..proof.len() - 1], &[]] {
        assert!(verify(&made.statement, wrong).is_err());
    }
}

/// Weights that are not those of the argument do not fit what it leaves to check: one value is changed in each tensor of each model.
#[test]
fn changed_weights_do_not_fit() {
    let mut made = Made::new(&Models::new(&EvalSpec::micro(), 1, 7));
    let published = verify(&made.statement, &made.proof()).unwrap().published;
    made.holds(&published).unwrap();
    let layout = Layout::new(&made.statement.spec.dims);
    for model in 0..2 {
        let before = made.models[model].clone();
        let read = |bytes: &[u8]| QuantisedWeights::from_bytes(&made.statement.spec, bytes);
        let changed: Vec<QuantisedWeights> = layout
            .tensors
            .iter()
            .map(|place| {
                let mut bytes = before.as_bytes().to_vec();
                bytes[2 * (place.start + place.len / 2)] ^= 1;
                read(&bytes).unwrap()
            })
            .collect();
        for (number, changed) in changed.into_iter().enumerate() {
            made.models[model] = changed;
            let refused = made.holds(&published);
            let expected = Refused::Equation("a claim about weights");
            assert_eq!(refused, Err(expected), "tensor {number} of model {model}");
        }
        made.models[model] = before;
    }
    assert_eq!(made.holds(&published), Ok(()));
}

/// The claims that are left travel as words. A changed word is noticed by the digest, and at the latest when the claims are checked.
#[test]
fn changed_claims_are_refused() {
    let made = Made::new(&Models::new(&EvalSpec::micro(), 1, 10));
    let published = verify(&made.statement, &made.proof()).unwrap().published;
    let scales = &made.statement.scales;
    let (words, digest) = (published.words(), published.digest(scales));
    let read = Published::from_words(&words).unwrap();
    assert_eq!(made.holds(&read), Ok(()));
    assert_eq!((read.words(), read.digest(scales)), (words.clone(), digest));
    let mut other = scales.clone();
    other[1][3] += 1;
    assert!(published.digest(&other) != digest);
    for number in 0..words.len() {
        for bit in [0, 9, 33, 63] {
            let mut changed = words.clone();
            changed[number] ^= 1 << bit;
            assert!(digest_of_words(scales, &changed) != digest);
            // Some changes do not matter, such as weights where tensors are padded. None makes the check panic.
            if let Some(read) = Published::from_words(&changed) {
                let _ = made.holds(&read);
            }
        }
    }
    let values = (0..published.claims.len()).flat_map(|number| [(number, 0), (number, 1)]);
    for (number, coefficient) in values {
        let mut read = Published::from_words(&words).unwrap();
        read.claims[number].value.0[coefficient] += Goldilocks::ONE;
        assert!(made.holds(&read).is_err(), "claim {number}");
    }
    for wrong in [
        &words[1..],
        &words[..words.len() - 1],
        &[],
        &[u64::MAX],
        &[1 << 40],
    ] {
        assert!(Published::from_words(wrong).is_none());
    }
}

/// A prover that argues what is false is refused, whatever it is that is false.
#[test]
fn what_is_false_is_refused() {
    let mut made = Made::new(&Models::new(&EvalSpec::micro(), 1, 8));
    for name in [
        "query",
        "distance to the largest score",
        "input norm",
        "residual stream",
        "velocity",
        "ranges",
    ] {
        let tensor = made
            .relations()
            .tensors
            .iter()
            .find(|tensor| tensor.name == name);
        let number = tensor.unwrap().offset;
        made.witnesses[0].main[number] += 1;
        assert!(verify(&made.statement, &made.proof()).is_err(), "{name}");
        made.witnesses[0].main[number] -= 1;
    }
    assert!(verify(&made.statement, &made.proof()).is_ok());
}
