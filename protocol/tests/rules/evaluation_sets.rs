//! A node commits to the frames that the hash of its episodes draws, and to no others.

use zk0_circuits::claim::challenge::DrawError;
use zk0_circuits::Digest;
use zk0_protocol::entries::proposal::Action;
use zk0_protocol::entries::signed::{DatasetRegistration, RegisteredEpisode};
use zk0_protocol::evaluation_set::{
    distinct, draw, list_bytes, total, DrawnLeaf, EvaluationSetError,
};
use zk0_protocol::{Body, Rules, Signed};
use zk0_testkit::network::*;

/// Three episodes of a thousand frames together.
fn episodes() -> Vec<RegisteredEpisode> {
    let frames = [300, 250, 450];
    let episode = |(number, frames)| RegisteredEpisode {
        digest: digest(number),
        frames,
    };
    (1..).zip(frames).map(episode).collect()
}

/// The list of a registration whose drawn frames all have samples of their own.
fn list(registration: &DatasetRegistration) -> Vec<DrawnLeaf> {
    let DatasetRegistration {
        network, episodes, ..
    } = registration;
    let drawn = draw(network, episodes, registration.evaluation_frames).unwrap();
    let leaf = |frame: u64| {
        let mut leaf = digest(0xee);
        leaf.0[..8].copy_from_slice(&frame.to_le_bytes());
        DrawnLeaf { frame, leaf }
    };
    drawn.into_iter().map(leaf).collect()
}

/// A registration of `count` drawn frames, all with samples of their own.
fn registration_of(count: u32) -> DatasetRegistration {
    let mut registration = registration(&digest(7), 0);
    (registration.episodes, registration.evaluation_frames) = (episodes(), count);
    registration.dataset.samples = registration.drawn();
    registration
}

/// The values were computed with Python's hashlib, by the text of the documentation.
#[test]
fn the_draw_is_the_documented_one() {
    let drawn = draw(&digest(7), &episodes(), 8).unwrap();
    assert_eq!(drawn, KNOWN);
}

const KNOWN: [u64; 8] = [5, 17, 312, 318, 469, 529, 941, 957];

#[test]
fn drawn_frames_are_distinct_ascending_and_of_the_recording() {
    for count in [1, 2, 100, 999] {
        let drawn = draw(&digest(7), &episodes(), count).unwrap();
        assert_eq!(drawn.len(), count as usize);
        assert!(drawn.is_sorted_by(|one, next| one < next));
        assert!(drawn.iter().all(|frame| *frame < 1000));
    }
    let all: Vec<u64> = (0..1000).collect();
    for count in [1000, 1001, u32::MAX] {
        assert_eq!(draw(&digest(7), &episodes(), count).unwrap(), all);
    }
    let longest = RegisteredEpisode {
        digest: digest(1),
        frames: u32::MAX,
    };
    for (episodes, count) in [(episodes(), 0), (vec![longest; 2], 4097)] {
        let error = draw(&digest(7), &episodes, count).unwrap_err();
        let available = total(&episodes);
        let asked = count;
        assert_eq!(error, DrawError { asked, available });
    }
    let drawn = draw(&digest(7), &[longest; 1500], 4096).unwrap();
    assert!(drawn.iter().any(|frame| *frame > u64::from(u32::MAX)));
}

#[test]
fn more_frames_are_those_before_and_others() {
    let few = draw(&digest(7), &episodes(), 50).unwrap();
    let many = draw(&digest(7), &episodes(), 60).unwrap();
    assert!(few.iter().all(|frame| many.binary_search(frame).is_ok()));
}

#[test]
fn the_draw_depends_on_the_network_and_on_every_episode() {
    let drawn =
        |network: u8, episodes: &[RegisteredEpisode]| draw(&digest(network), episodes, 50).unwrap();
    let before = drawn(7, &episodes());
    assert_ne!(drawn(8, &episodes()), before);
    for number in 0..3 {
        let mut other = episodes();
        other[number].digest.0[31] ^= 1;
        assert_ne!(drawn(7, &other), before, "digest of episode {number}");
    }
    // The number of frames in all stays the same.
    let mut moved = episodes();
    moved[0].frames += 1;
    moved[2].frames -= 1;
    assert_ne!(drawn(7, &moved), before);
}

#[test]
fn a_registration_with_frames_that_were_not_drawn_is_refused_by_name() {
    let registration = registration_of(50);
    let honest = list(&registration);
    assert_eq!(
        registration.read_list(&list_bytes(&honest)).unwrap(),
        honest
    );
    let reported = |list: &[DrawnLeaf]| registration.read_list(&list_bytes(list)).unwrap_err();

    // A frame beside a drawn one, which the node likes better.
    let mut other = honest.clone();
    other[20].frame += 1;
    let (listed, drawn) = (other[20].frame, honest[20].frame);
    let refused = EvaluationSetError::NotDrawn {
        place: 20,
        listed,
        drawn,
    };
    assert_eq!(reported(&other), refused);
    let text = refused.to_string();
    assert!(
        text.contains(&format!("frame {listed} stands at place 20"))
            && text.contains(&format!("draws frame {drawn}")),
        "{text}"
    );

    // The drawn frames in another order.
    let mut swapped = honest.clone();
    swapped.swap(3, 4);
    assert!(matches!(
        reported(&swapped),
        EvaluationSetError::NotDrawn { place: 3, .. }
    ));

    // One frame less, one more, one twice, and a record that is cut off.
    let (mut more, mut twice) = (honest.clone(), honest.clone());
    more.push(honest[0]);
    twice[1] = honest[0];
    let length = |bytes| EvaluationSetError::Length { bytes, drawn: 50 };
    assert_eq!(reported(&honest[..49]), length(49 * 40));
    assert_eq!(reported(&more), length(51 * 40));
    assert!(matches!(
        reported(&twice),
        EvaluationSetError::NotDrawn { place: 1, .. }
    ));
    let bytes = list_bytes(&honest);
    for cut in [0, 1, 39, 50 * 40 - 1] {
        assert_eq!(registration.read_list(&bytes[..cut]), Err(length(cut)));
    }
}

#[test]
fn frames_with_equal_samples_count_once() {
    let mut registration = registration_of(50);
    let mut still = list(&registration);
    let leaves: Vec<Digest> = still.iter().map(|drawn| drawn.leaf).collect();
    // The camera and the robot stand still in three of the drawn frames.
    (still[12].leaf, still[13].leaf) = (still[11].leaf, still[11].leaf);
    let expected = [&leaves[..12], &leaves[14..]].concat();
    assert_eq!(distinct(&still), expected);
    let bytes = list_bytes(&still);
    // The commitment counts 50 samples. Copies must not count.
    assert_eq!(
        registration.read_list(&bytes),
        Err(EvaluationSetError::Count {
            distinct: 48,
            samples: 50
        })
    );
    registration.dataset.samples = 48;
    assert_eq!(registration.read_list(&bytes).unwrap(), still);
    registration.dataset.samples = 47;
    assert!(registration.read_list(&bytes).is_err());
}

#[test]
fn the_ledger_checks_what_it_can_see_of_an_evaluation_set() {
    let mut chain = Chain::new();
    let network = *chain.state.network();
    chain.apply(enrolled(0));
    let with = |change: fn(&mut DatasetRegistration)| {
        let mut registration = registration(&network, 0);
        change(&mut registration);
        Body::DatasetCommitted(Signed::new(registration, &key(0)))
    };
    type Case = (fn(&mut DatasetRegistration), &'static str);
    let cases: [Case; 5] = [
        (
            |one| one.evaluation_frames -= 1,
            "draws 299 frames, but the rules ask for 300",
        ),
        (
            |one| one.evaluation_frames = u32::MAX,
            "but the rules ask for 300",
        ),
        (|one| one.episodes[1].frames = 0, "has no frames"),
        (
            |one| one.dataset.samples = 301,
            "301 samples, but only 300 frames are drawn",
        ),
        (
            |one| {
                one.episodes.iter_mut().for_each(|each| each.frames = 7);
                one.dataset.samples = 15;
            },
            "15 samples, but only 14 frames are drawn",
        ),
    ];
    for (change, why) in cases {
        let told = chain.refusal(with(change)).to_string();
        assert!(told.contains(why), "{told}");
    }
    chain.apply(with(|one| one.dataset.samples = 300));
}

#[test]
fn a_registered_dataset_keeps_its_number_of_frames_when_the_rule_changes() {
    let mut chain = Chain::in_round(1);
    let network = *chain.state.network();
    chain.close(weights(4));
    let rules = Rules {
        evaluation_frames: 320,
        ..genesis().rules
    };
    chain.decide(Action::ChangeRules(Box::new(rules)));
    chain.apply(enrolled(1));
    // The rule in force counts for who registers now.
    let told = chain.refusal(registered(&network, 1)).to_string();
    assert!(told.contains("the rules ask for 320"), "{told}");
    let mut registration = registration(&network, 1);
    registration.evaluation_frames = 320;
    chain.apply(Body::DatasetCommitted(Signed::new(registration, &key(1))));
    // The node that registered before goes on.
    chain.open();
    chain.apply(committed(&chain.state, 0, weights(0x10)));
}
