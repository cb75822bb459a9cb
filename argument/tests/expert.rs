//! The expert's argument: what the evaluation computes is accepted, and what is changed is refused.

mod models;

use models::claims::Random;
use models::Models;
use zk0_argument::expert::argument::{prove::prove, verify, Published};
use zk0_argument::expert::builder::{MAIN, WEIGHTS};
use zk0_argument::expert::evaluation::layers::Expert;
use zk0_argument::expert::sample;
use zk0_argument::expert::sizes::P;
use zk0_argument::expert::statement::Statement;
use zk0_argument::expert::witness::{evaluate, Witness};
use zk0_argument::prove::{check, Computed, Tables, Violation};
use zk0_argument::relation::Relations;
use zk0_argument::transcript::Refused;
use zk0_circuits::{EvalSpec, Sample};

/// A statement, and all values behind it.
struct Made {
    statement: Statement,
    expert: Expert,
    witness: Witness,
}

impl Made {
    fn new(models: &Models) -> Self {
        let weights = [&models.base, &models.update];
        let (statement, kept) = evaluate(&models.spec, weights, &models.samples).unwrap();
        let expert = Expert::new(&statement);
        let witness = Witness::new(&statement, &expert, weights, &models.samples, &kept).unwrap();
        Self {
            statement,
            expert,
            witness,
        }
    }

    fn relations(&self) -> &Relations {
        &self.expert.builder.relations
    }

    fn check(&self) -> Result<(), Violation> {
        check(&Tables {
            relations: self.relations(),
            sources: &self.witness.sources(),
            computed: &Computed::default(),
        })
    }

    fn proof(&self) -> Vec<u64> {
        prove(&self.statement, &self.expert, &self.witness).unwrap()
    }

    /// Verifies, and checks what is left with the weights and tables.
    fn verify(&self, statement: &Statement, proof: &[u64]) -> Result<Published, Refused> {
        let published = verify(statement, proof)?;
        published.holds(&self.witness.weights, &self.witness.tables)?;
        Ok(published)
    }
}

#[test]
fn an_evaluation_is_accepted() {
    for samples in [1, 2, 3] {
        let made = Made::new(&Models::new(&EvalSpec::micro(), samples, samples as u64));
        assert_eq!(made.check(), Ok(()));
        made.verify(&made.statement, &made.proof()).unwrap();
    }
}

/// One value of each committed tensor is changed. Some relation names it.
#[test]
fn a_changed_value_breaks_a_relation() {
    let mut made = Made::new(&Models::new(&EvalSpec::micro(), 2, 4));
    let mut random = Random(4);
    let tensors = made.relations().tensors.clone();
    for tensor in tensors.iter().filter(|tensor| tensor.source == MAIN) {
        // Token 0 counts in every sample, and every token sees the one in the middle of all that is attended to.
        let index = tensor.places.iter().skip(1);
        let number = index.fold(tensor.offset, |number, place| {
            let middle = 1usize << place.bits >> 1;
            let first = place.bits != made.expert.builder.sizes.of(P) && random.bits() & 1 == 0;
            number + (if first { 0 } else { middle } << place.shift)
        });
        let before = made.witness.main[number];
        made.witness.main[number] += 1;
        assert!(made.check().is_err(), "value {number} of {}", tensor.name);
        made.witness.main[number] = before;
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
        actions.number(&[short.frames, 0, 1]),
        keys.number(&[short.prefix, 0, 0, 0, 1]),
        values.number(&[short.prefix, 0, 0, 0, 1]),
        // There is no fourth sample, but a segment for one.
        keys.number(&[0, 0, 0, 0, 3]),
    ];
    // Layer 0 is one of self-attention: it projects nothing of the prefix. The cheat counts right that it looks up 1 in place of 0, both 2^15 more, among the values of 16 bits.
    let ranges = tensors
        .iter()
        .find(|tensor| tensor.name == "ranges")
        .unwrap();
    let [zero, one] = [0, 1].map(|value| ranges.number(&[(1 << 16) + (1 << 15) + value, 0]));
    for number in unread {
        assert_eq!(made.witness.data[number], 0);
        made.witness.data[number] = 1;
        made.witness.main[zero] -= 1;
        made.witness.main[one] += 1;
        let violation = made.check().unwrap_err().to_string();
        assert!(violation.contains("where nothing is read"), "{violation}");
        let refused = made.verify(&made.statement, &made.proof()).err();
        let expected = Refused::Equation("what a sample holds where nothing is read");
        assert_eq!(refused, Some(expected), "value {number} of the samples");
        made.witness.data[number] = 0;
        made.witness.main[zero] += 1;
        made.witness.main[one] -= 1;
    }
    // An action dimension beyond those of the robot has noise alone, with which the evaluation calculates.
    let unused = actions.number(&[0, dims.action_dim as usize, 1]);
    made.witness.data[unused] = 1;
    assert!(made.check().is_err());
    made.witness.data[unused] = 0;
    assert_eq!(made.check(), Ok(()));
}

/// A node commits to a sample before there are weights. The proof is about that sample.
#[test]
fn a_proof_names_the_samples_as_they_were_committed_to() {
    let models = Models::new(&EvalSpec::micro(), 3, 9);
    let made = Made::new(&models);
    let published = made.verify(&made.statement, &made.proof()).unwrap();
    let digest = |sample: &Sample| sample::prove::digest(&models.spec, sample).unwrap();
    let expected: Vec<_> = models
        .samples
        .iter()
        .map(|(sample, _)| digest(sample))
        .collect();
    assert_eq!(published.samples, expected);
    assert!(expected[0] != expected[1] && expected[1] != expected[2] && expected[0] != expected[2]);
}

/// Something changes in a statement.
type Change = fn(&mut Statement);

#[test]
fn a_changed_statement_is_refused() {
    let made = Made::new(&Models::new(&EvalSpec::micro(), 2, 5));
    let proof = made.proof();
    made.verify(&made.statement, &proof).unwrap();
    let changes: [(&str, Change); 12] = [
        ("loss", |s| s.samples[0].losses[0] += 1),
        ("losses swapped", |s| s.samples[1].losses.reverse()),
        ("samples swapped", |s| s.samples.reverse()),
        ("frames", |s| s.samples[0].frames -= 1),
        ("prefix", |s| s.samples[1].prefix += 1),
        ("noise", |s| s.samples[1].draw.noise[3] += 1),
        ("time", |s| s.samples[0].draw.time ^= 1),
        ("weights", |s| s.weights[1].0[0] ^= 1),
        ("weights swapped", |s| s.weights.reverse()),
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

/// Weights and tables that are not those of the argument do not fit what it leaves to check.
#[test]
fn changed_weights_do_not_fit() {
    let mut made = Made::new(&Models::new(&EvalSpec::micro(), 1, 7));
    let published = verify(&made.statement, &made.proof()).unwrap();
    let holds = |made: &Made| published.holds(&made.witness.weights, &made.witness.tables);
    holds(&made).unwrap();
    let tensors: Vec<_> = made
        .relations()
        .tensors
        .iter()
        .filter(|t| t.source == WEIGHTS)
        .collect();
    let offsets: Vec<usize> = tensors.iter().map(|tensor| tensor.offset).collect();
    for offset in offsets {
        made.witness.weights[offset] ^= 1;
        assert!(holds(&made).is_err());
        made.witness.weights[offset] ^= 1;
    }
    for row in [0, 5, made.witness.tables.len() / 2] {
        made.witness.tables[row] += 1;
        assert!(holds(&made).is_err());
        made.witness.tables[row] -= 1;
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
        made.witness.main[number] += 1;
        assert!(verify(&made.statement, &made.proof()).is_err(), "{name}");
        made.witness.main[number] -= 1;
    }
    assert!(verify(&made.statement, &made.proof()).is_ok());
}
