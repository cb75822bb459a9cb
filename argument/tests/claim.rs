//! Mode `succinct`: an honest claim states what mode `direct` states, and the statement refuses every cheat that one of its checks stops.

use crate::models::{committed_to, BLIND};
use std::borrow::Cow;
use std::{fs, io};
use zk0_argument::claim::{
    check, committed, digest_of, make, most_samples, most_uses, ClaimInput, ClaimSource, NotMade,
    NotShown,
};
use zk0_argument::expert::prover_values::Unprovable;
use zk0_argument::prove::progress::Phase;
use zk0_argument::transcript::Refused;
use zk0_circuits::claim::private_input::{Header, InputError};
use zk0_circuits::claim::statement;
use zk0_circuits::claim::statement_error::StatementError;
use zk0_circuits::model::layout::Layout;
use zk0_circuits::model::spec::Dims;
use zk0_circuits::vm::merkle;
use zk0_circuits::{
    Claim, Digest, Disclosure, EvalSpec, Losses, Mode, PrivateInput, QuantisedWeights, Sample,
};
use zk0_testkit::claims::{honest, ClaimingNode, Honest};

/// A node of a network that proves in mode `succinct`.
fn node() -> Honest {
    committed_to(honest(&EvalSpec::micro(), 20, 3, 11))
}

fn claim(input: &ClaimInput) -> Result<Claim, NotShown> {
    check(input).map(|(claim, _)| claim)
}

#[test]
fn a_claim_says_what_mode_direct_says() {
    let direct = honest(&EvalSpec::micro(), 20, 3, 11);
    let made = make(&node().input, &BLIND, None, &mut |_| {}).unwrap();
    let buffers = made.to_buffers();
    let read = ClaimInput::from_buffers(&buffers).unwrap();
    assert_eq!(read, made);
    let (claim, left) = check(&read).unwrap();
    assert_eq!(claim.terms, node().input.header.terms);
    assert_eq!(
        claim.losses,
        statement::check(&direct.input).unwrap().losses
    );
    assert_eq!(claim.weight_check, Some(left.digest(&made.scales)));
}

/// A private input of which one sample cannot be read.
struct Unreadable(PrivateInput);

impl ClaimSource for Unreadable {
    fn header(&self) -> &Header {
        self.0.header()
    }

    fn models(&self) -> [&QuantisedWeights; 2] {
        self.0.models()
    }

    fn places(&self) -> Vec<(u64, &[Digest])> {
        self.0.places()
    }

    fn sample(&self, position: usize) -> io::Result<Cow<'_, Sample>> {
        match position {
            2 => Err(io::Error::other("the disk is broken")),
            _ => self.0.sample(position),
        }
    }
}

#[test]
fn a_sample_that_cannot_be_read_is_named() {
    let error = make(&Unreadable(node().input), &BLIND, None, &mut |_| {}).unwrap_err();
    let text = error.to_string();
    assert!(
        text.contains("sample 2") && text.contains("the disk is broken"),
        "{text}"
    );
}

/// A private input with what is kept of the commitments to its samples.
struct Kept {
    input: PrivateInput,
    kept: Vec<Vec<u8>>,
}

impl Kept {
    fn new() -> Self {
        let input = node().input;
        let kept = input.openings.iter().map(|opening| {
            let spec = &input.header.spec;
            committed(Mode::Succinct, spec, &opening.sample, &BLIND).kept
        });
        let kept = kept.collect();
        Self { input, kept }
    }
}

impl ClaimSource for Kept {
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
        self.input.sample(position)
    }

    fn kept(&self, position: usize) -> io::Result<Vec<u8>> {
        Ok(self.kept[position].clone())
    }
}

/// A sample is not hashed a second time. Whatever is kept of its commitment, it is this sample that is shown, or nothing.
#[test]
fn what_is_kept_of_a_commitment_opens_it() {
    let mut source = Kept::new();
    let made = make(&source, &BLIND, None, &mut |_| {}).unwrap();
    claim(&made).unwrap();
    for (sample, opening) in source.input.openings.iter().enumerate() {
        let of = digest_of(
            Mode::Succinct,
            &source.input.header.spec,
            &opening.sample,
            &source.kept[sample],
        );
        let expected = committed(
            Mode::Succinct,
            &source.input.header.spec,
            &opening.sample,
            &BLIND,
        );
        assert_eq!(of, expected.digest);
    }

    source.kept.swap(0, 1);
    let made = make(&source, &BLIND, None, &mut |_| {}).unwrap();
    assert!(claim(&made).is_err());
    source.kept.swap(0, 1);
    source.kept[1].truncate(32);
    let error = make(&source, &BLIND, None, &mut |_| {}).unwrap_err();
    assert!(error.to_string().contains("tree of sample 1"), "{error}");
}

/// The folder is gone after the samples were committed to, when the values of all samples are needed at once.
#[test]
fn a_folder_that_goes_away_ends_the_argument() {
    let folder = tempfile::tempdir().unwrap();
    let mut remove = |share: f64| {
        if share >= Phase::Claiming.of_all(1.0) && folder.path().exists() {
            fs::remove_dir_all(folder.path()).unwrap();
        }
    };
    let made = make(&node().input, &BLIND, Some(folder.path()), &mut remove);
    let of_a_file = |error: &NotMade| matches!(error, NotMade::Unprovable(Unprovable::File(_)));
    assert!(made.as_ref().is_err_and(of_a_file), "{made:?}");
}

/// Whoever waits for an argument is told after each piece of it, in all phases, and at the end that all is done.
#[test]
fn a_prover_tells_how_far_it_is() {
    let mut told = vec![];
    make(&node().input, &BLIND, None, &mut |share| told.push(share)).unwrap();
    assert!(told.is_sorted() && told.last() == Some(&1.0), "{told:?}");
    let within = |phase: Phase| {
        let (from, to) = (phase.of_all(0.0), phase.of_all(1.0));
        let within = told.iter().filter(|&&share| from < share && share <= to);
        within.count()
    };
    for phase in Phase::ALL {
        assert!(within(phase) > 0, "{phase:?}: {told:?}");
    }
    // The longest phases have pieces for each of the three samples. What is opened are its values, itself, and the random columns.
    assert_eq!(within(Phase::Committing), 6, "{told:?}");
    assert_eq!(within(Phase::Adding), 6, "{told:?}");
    assert_eq!(within(Phase::Opening), 7, "{told:?}");
}

#[test]
fn hidden_losses_stay_hidden() {
    let mut node = node();
    node.input.header.disclosure = Disclosure::Nothing;
    let made = make(&node.input, &BLIND, None, &mut |_| {}).unwrap();
    assert_eq!(claim(&made).unwrap().losses, Losses::Hidden);
}

/// What goes to the proving service holds no value of a sample and no weight. It grows little with samples.
#[test]
fn the_input_holds_neither_samples_nor_weights() {
    let node = node();
    let bytes = make(&node.input, &BLIND, None, &mut |_| {})
        .unwrap()
        .to_buffers()
        .concat();
    let windows: std::collections::HashSet<&[u8]> = bytes.windows(32).collect();
    let private = node.dataset.iter().map(|sample| sample.as_bytes());
    // The scales of weights, which come first, are no secret.
    let scales = 2 * Layout::new(&node.input.header.spec.dims).tensors.len();
    let weights = [&node.input.base, &node.input.update].map(|w| &w.as_bytes()[scales..]);
    for secret in private.chain(weights) {
        // Zeros are everywhere.
        let pieces = secret
            .chunks_exact(32)
            .filter(|p| p.iter().any(|&b| b != 0));
        for piece in pieces {
            assert!(!windows.contains(piece), "32 bytes of a secret");
        }
    }
}

/// An update that is no improvement is refused before an argument is made, and an argument that it is one is refused by the guest.
#[test]
fn what_does_not_improve_is_refused() {
    let mut node = node();
    let mut swapped = node.input.clone();
    core::mem::swap(&mut swapped.base, &mut swapped.update);
    let terms = &mut swapped.header.terms;
    core::mem::swap(&mut terms.base, &mut terms.update);
    assert!(matches!(
        make(&swapped, &BLIND, None, &mut |_| {}),
        Err(NotMade::Statement(StatementError::NoImprovement { .. }))
    ));
    // The node argues what is true under easier terms, and then claims it under the round's.
    node.input.header.terms.test.min_improvement_bps = 0;
    let mut made = make(&node.input, &BLIND, None, &mut |_| {}).unwrap();
    made.header.terms.test.min_improvement_bps = 9999;
    let refused = claim(&made).unwrap_err();
    assert!(matches!(refused, NotShown::Argument(_)), "{refused}");
    node.input.header.terms.test.min_improvement_bps = 9999;
    assert!(matches!(
        make(&node.input, &BLIND, None, &mut |_| {}),
        Err(NotMade::Statement(StatementError::NoImprovement { .. }))
    ));
}

/// Something changes in an input.
type Cheat = fn(&mut ClaimInput);

/// The transcript begins with the whole header, so that an argument is about one challenge, one dataset and two sets of weights alone.
#[test]
fn an_argument_is_about_one_header() {
    let made = make(&node().input, &BLIND, None, &mut |_| {}).unwrap();
    claim(&made).unwrap();
    let cheats: [(&str, Cheat); 15] = [
        ("network", |i| i.header.terms.network.0[0] ^= 1),
        ("round", |i| i.header.terms.round += 1),
        ("node", |i| i.header.terms.node.0[0] ^= 1),
        ("root", |i| i.header.terms.dataset.root.0[0] ^= 1),
        ("samples", |i| i.header.terms.dataset.samples += 1),
        ("features", |i| {
            i.header.terms.dataset.feature_spec.0[0] ^= 1
        }),
        ("base file", |i| i.header.terms.base.blob.0[0] ^= 1),
        ("base", |i| i.header.terms.base.quantised.0[0] ^= 1),
        ("update file", |i| i.header.terms.update.blob.0[0] ^= 1),
        ("update", |i| i.header.terms.update.quantised.0[0] ^= 1),
        ("challenge", |i| i.header.terms.challenge.0[0] ^= 1),
        ("least improvement", |i| {
            i.header.terms.test.min_improvement_bps -= 1
        }),
        ("disclosure", |i| i.header.disclosure = Disclosure::Nothing),
        ("salt", |i| i.header.salt[0] ^= 1),
        ("salt commitment", |i| {
            i.header.terms.dataset.salt_commitment.0[0] ^= 1
        }),
    ];
    for (what, cheat) in cheats {
        let mut changed = made.clone();
        cheat(&mut changed);
        let refused = claim(&changed).unwrap_err();
        assert!(
            matches!(refused, NotShown::Argument(_)),
            "{what}: {refused}"
        );
    }
}

/// Each of these is refused by name.
#[test]
fn what_is_not_in_the_argument_is_checked_by_itself() {
    let made = make(&node().input, &BLIND, None, &mut |_| {}).unwrap();
    let drawn = made.openings[0].index;
    let cheats: [(Cheat, NotShown); 8] = [
        (
            |i| i.openings[0].path[1].0[0] ^= 1,
            StatementError::NotCommitted { index: drawn }.into(),
        ),
        (
            |i| i.openings[0].index ^= 1,
            StatementError::Index {
                position: 0,
                found: drawn ^ 1,
                drawn,
            }
            .into(),
        ),
        (
            |i| drop(i.openings.pop()),
            StatementError::Openings {
                claimed: 3,
                opened: 2,
            }
            .into(),
        ),
        (|i| i.scales[1][0] += 90, Refused::Bounds("a scale").into()),
        (
            |i| i.scales[0].truncate(3),
            Refused::Bounds("the number of scales").into(),
        ),
        (
            |i| i.openings[1].prefix = 0,
            Refused::Bounds("the prefix of a sample").into(),
        ),
        (
            |i| i.openings[1].frames = u32::MAX,
            Refused::Bounds("the frames of a sample").into(),
        ),
        (
            |i| i.openings[2].losses[0] = u64::MAX,
            Refused::Bounds("a loss").into(),
        ),
    ];
    for (cheat, expected) in cheats {
        let mut changed = made.clone();
        cheat(&mut changed);
        assert_eq!(claim(&changed), Err(expected));
    }
}

/// The node argues honestly about a sample that is not the one that was drawn, or about one that it has not committed to.
#[test]
fn an_argument_about_other_samples_is_refused() {
    let node = node();
    let easy = (0..20)
        .find(|index| node.input.openings.iter().all(|o| o.index != *index))
        .unwrap();
    let mut other = node.input.clone();
    other.openings[0].sample = node.dataset[easy as usize].clone();
    other.openings[0].path = merkle::path(&node.leaves, easy as usize).unwrap();
    let index = other.openings[0].index;
    let made = make(&other, &BLIND, None, &mut |_| {}).unwrap();
    let not_committed = StatementError::NotCommitted { index };
    assert_eq!(claim(&made), Err(not_committed.into()));
    let mut named = other.clone();
    named.openings[0].index = easy;
    let made = make(&named, &BLIND, None, &mut |_| {}).unwrap();
    assert!(matches!(
        claim(&made),
        Err(NotShown::Statement(StatementError::Index { .. }))
    ));
    // The salt of the commitments is the dataset's.
    let mut salted = node.input.clone();
    salted.header.salt[5] ^= 1;
    let made = make(&salted, &BLIND, None, &mut |_| {}).unwrap();
    assert_eq!(claim(&made), Err(StatementError::Salt.into()));
    // Another specification than the round's.
    let mut specified = node.input.clone();
    specified.header.terms.evaluation = Digest([1; 32]);
    let made = make(&specified, &BLIND, None, &mut |_| {}).unwrap();
    assert!(matches!(
        claim(&made),
        Err(NotShown::Statement(StatementError::Evaluation { .. }))
    ));
}

#[test]
fn buffers_that_are_no_input_are_refused() {
    let buffers = make(&node().input, &BLIND, None, &mut |_| {})
        .unwrap()
        .to_buffers();
    let said = |buffers: &[Vec<u8>]| ClaimInput::from_buffers(buffers).map(drop).unwrap_err();
    assert_eq!(
        said(&buffers[..1]),
        InputError::Buffers {
            found: 1,
            expected: 2
        }
    );
    let mut longer = buffers.clone();
    longer[0].push(0);
    assert_eq!(said(&longer), InputError::Header);
    let mut odd = buffers.clone();
    odd[1].push(0);
    assert_eq!(said(&odd), InputError::TrailingBytes(1));
    for cut in [0, 10, buffers[0].len() / 2, buffers[0].len() - 1] {
        let shorter = [buffers[0][..cut].to_vec(), buffers[1].clone()];
        assert_eq!(said(&shorter), InputError::Header);
    }
    // Where the bytes are not aligned, the words are copied.
    let mut padded = vec![0; 1];
    padded.extend(&buffers[1]);
    let unaligned = [&buffers[0][..], &padded[1..]];
    assert!(ClaimInput::from_buffers(&unaligned).is_ok());
}

/// Duplicates are seen without seeing any data: equal samples have equal leaves.
#[test]
fn equal_samples_are_committed_to_alike() {
    let spec = EvalSpec::micro();
    let dataset = ClaimingNode::new(&spec, 3, 2, 5).honest().dataset;
    let digests = [Mode::Direct, Mode::Succinct].map(|mode| {
        dataset
            .iter()
            .map(|s| committed(mode, &spec, s, &BLIND).digest)
            .collect::<Vec<_>>()
    });
    let [direct, succinct] = digests;
    assert!(direct.iter().zip(&succinct).all(|(a, b)| a != b));
    let again = committed(Mode::Succinct, &spec, &dataset[1].clone(), &BLIND).digest;
    assert_eq!(again, succinct[1]);
    assert!(succinct[0] != succinct[1] && succinct[1] != succinct[2]);
}

/// A claim about more samples has no argument: there are too few pads.
#[test]
fn small_samples_leave_room_for_fewer_of_them() {
    assert_eq!(
        most_samples(Mode::Succinct, &EvalSpec::new(Dims::FULL)),
        256
    );
    let most = most_samples(Mode::Succinct, &EvalSpec::micro());
    assert!((40..100).contains(&most), "{most}");
    assert_eq!(most_uses(&EvalSpec::micro()), 33);
    assert_eq!(most_uses(&EvalSpec::new(Dims::FULL)), 2148);
}
