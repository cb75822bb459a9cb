//! Cheats about the claim: the samples are those of the dataset, how much of them is read included; the test of the improvement; and the
//! statement, which a transcript begins with.

use super::lies::{self, known};
use crate::models::{committed_to, Models, BLIND};
use zk0_argument::claim::{check, context, make, ClaimInput, NotShown, SampleOpening};
use zk0_argument::expert::prover_values::evaluate;
use zk0_argument::expert::statement::{Statement, MOST_SAMPLES};
use zk0_argument::prove::progress::silently;
use zk0_argument::transcript::Refused;
use zk0_circuits::claim::private_input::InputError;
use zk0_circuits::claim::statement_error::StatementError;
use zk0_circuits::model::draw::draw;
use zk0_circuits::vm::merkle;
use zk0_circuits::{Digest, EvalSpec, Sample};
use zk0_testkit::claims::{honest, FloatSample, Random};

/// A node has one sample in its dataset, and argues about another one, with the path of the first.
fn told(committed: &Sample, evaluated: &Sample) -> Result<(), NotShown> {
    let mut node = honest(&EvalSpec::micro(), 20, 3, 71);
    let index = node.input.openings[0].index as usize;
    node.dataset[index] = committed.clone();
    let mut node = committed_to(node);
    node.input.openings[0].sample = evaluated.clone();
    node.input.openings[0].path = merkle::path(&node.leaves, index).unwrap();
    check(&make(&node.input, &BLIND, None, &mut |_| {}).unwrap()).map(drop)
}

fn not_committed() -> Result<(), NotShown> {
    let index = honest(&EvalSpec::micro(), 20, 3, 71).input.openings[0].index;
    Err(StatementError::NotCommitted { index }.into())
}

#[test]
fn a_sample_with_other_values_is_not_the_committed_one() {
    let spec = EvalSpec::micro();
    let [committed, evaluated] =
        [77, 78].map(|seed| FloatSample::random(&spec, &mut Random(seed), 3, 0).quantise(&spec));
    assert_eq!(told(&committed, &evaluated), not_committed());
}

#[test]
fn a_frame_of_padding_does_not_count() {
    let spec = EvalSpec::micro();
    let mut parts = FloatSample::random(&spec, &mut Random(72), 3, 2);
    let chunk = spec.dims.chunk as usize;
    let width = spec.dims.max_action_dim as usize;
    parts.actions[(chunk - 2) * width..].fill(0.0);
    let committed = parts.quantise(&spec);
    parts.is_pad[chunk - 2] = false;
    assert_eq!(told(&committed, &parts.quantise(&spec)), not_committed());
}

#[test]
fn a_token_beyond_the_prefix_is_not_read() {
    let spec = EvalSpec::micro();
    let mut parts = FloatSample::random(&spec, &mut Random(73), 3, 0);
    let committed = parts.quantise(&spec);
    for (keys, values) in &mut parts.cache {
        for all in [keys, values] {
            all.resize(all.len() / 3 * 4, 0.0);
        }
    }
    assert_eq!(told(&committed, &parts.quantise(&spec)), not_committed());
}

/// `make` refuses an update that does not improve. This node argues without it: honestly, about its base in place of an update.
#[test]
fn an_update_that_does_not_improve_is_refused() {
    let mut node = honest(&EvalSpec::micro(), 20, 3, 76);
    node.input.update = node.input.base.clone();
    let input = committed_to(node).input;
    let header = &input.header;
    let openings = input.openings.iter().enumerate();
    let samples = openings.map(|(position, opening)| {
        let (challenge, count) = (&header.terms.challenge, header.terms.eval_samples);
        let draw = draw(&header.spec, challenge, position as u32, count);
        (opening.sample.clone(), draw)
    });
    let samples: Vec<_> = samples.collect();
    let models = [&input.base, &input.update];
    let statement = evaluate(context(header), &header.spec, models, &samples, &silently).unwrap();
    let known = known(&statement, models, &samples);
    let openings = input.openings.iter().zip(&statement.samples);
    let openings = openings.map(|(opening, evaluated)| SampleOpening {
        index: opening.index,
        path: opening.path.clone(),
        prefix: evaluated.prefix as u32,
        frames: evaluated.frames as u32,
        losses: evaluated.losses,
    });
    let claimed = ClaimInput {
        header: header.clone(),
        scales: statement.scales.clone(),
        saturates: statement.saturates,
        openings: openings.collect(),
        argument: lies::honest(&statement, &known).into(),
    };
    let told = check(&claimed).map(drop);
    let no_improvement = |error: &NotShown| {
        matches!(
            error,
            NotShown::Statement(StatementError::NoImprovement { .. })
        )
    };
    assert!(told.as_ref().is_err_and(no_improvement), "{told:?}");
}

#[test]
fn a_specification_that_is_not_valid_is_refused() {
    let node = committed_to(honest(&EvalSpec::micro(), 20, 3, 74));
    let mut made = make(&node.input, &BLIND, None, &mut |_| {}).unwrap();
    made.header.spec.dims.heads = 0;
    let read = ClaimInput::from_buffers(&made.to_buffers()).map(drop);
    assert!(matches!(read, Err(InputError::Spec(_))), "{read:?}");
}

/// Two samples and what is stated about them.
fn statement() -> Statement {
    let models = Models::new(&EvalSpec::micro(), 2, 75);
    let weights = [&models.base, &models.update];
    let evaluated = evaluate(
        Digest([1; 32]),
        &models.spec,
        weights,
        &models.samples,
        &silently,
    );
    evaluated.unwrap()
}

/// Something changes in a statement.
type Change = fn(&mut Statement);

/// The transcript begins with the statement. What it left out, a prover could choose when it knows the random points: it would solve
/// equations for it. The context stands for the specification, the weights and the challenge.
#[test]
fn a_transcript_begins_with_all_of_the_statement() {
    let statement = statement();
    let changes: [Change; 7] = [
        |s| s.saturates ^= true,
        |s| s.context.0[0] ^= 1,
        |s| s.scales[0][1] += 1,
        |s| s.scales[1][1] += 1,
        |s| s.samples[1].prefix -= 1,
        |s| s.samples[0].frames -= 1,
        |s| s.samples[1].losses[1] += 1,
    ];
    for (number, change) in changes.into_iter().enumerate() {
        let mut changed = statement.clone();
        change(&mut changed);
        assert!(changed.digest() != statement.digest(), "change {number}");
    }
}

/// Where the values of a sample or the number of samples are beyond what the relations are made for.
#[test]
fn statements_out_of_bounds_are_refused() {
    let statement = statement();
    assert_eq!(statement.check_bounds(), Ok(()));
    let changes: [(Change, &str); 3] = [
        (|s| s.samples.clear(), "the number of samples"),
        (
            |s| s.samples = vec![s.samples[0].clone(); MOST_SAMPLES + 1],
            "the number of samples",
        ),
        (
            |s| s.samples[1].draw.noise.truncate(1),
            "the noise of a sample",
        ),
    ];
    for (change, what) in changes {
        let mut changed = statement.clone();
        change(&mut changed);
        assert_eq!(changed.check_bounds(), Err(Refused::Bounds(what)));
    }
}
