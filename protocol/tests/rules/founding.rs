//! The genesis, versions, times, and the first enrolments.

use super::Breaks;
use zk0_circuits::{Mode, NodeId};
use zk0_protocol::challenge::drand::DrandChain;
use zk0_protocol::challenge::source::RandomnessSource;
use zk0_protocol::entries::codec::EntryError;
use zk0_protocol::entries::entry::ENTRY_VERSION;
use zk0_protocol::entries::member::NodeEnrolled;
use zk0_protocol::rules::closing::shares::Shares;
use zk0_protocol::rules::network_rules::{Participation, Strategy};
use zk0_protocol::rules::upper_bounds::{
    MAX_CREDITS, MAX_GOVERNANCE_WINDOW_MS, MAX_PROOF_BYTES, MAX_ROUND_WINDOW_MS, MAX_UPDATE_BYTES,
};
use zk0_protocol::{Body, RuleViolation, Rules, State};
use zk0_testkit::network::*;

#[test]
fn genesis_comes_first_and_only_first() {
    assert_eq!(
        State::found(&entry(T0, enrolled(0))),
        Err(RuleViolation::NoGenesis)
    );
    assert_eq!(
        Chain::new().refusal(Body::Genesis(genesis())),
        RuleViolation::SecondGenesis
    );
}

#[test]
fn a_genesis_has_to_make_sense() {
    let broken: [Breaks<zk0_protocol::Genesis>; 33] = [
        ("evaluation", |g| g.evaluation[0] ^= 1),
        ("evaluation", |g| g.evaluation.push(0)),
        ("min_eval_samples", |g| g.rules.min_eval_samples = 11),
        ("max_eval_samples", |g| g.rules.max_eval_samples = 1),
        ("max_eval_samples", |g| g.rules.max_eval_samples = 5000),
        ("name", |g| g.name = "two words".into()),
        ("name", |g| g.name = "".into()),
        ("name", |g| g.name = "a+b".into()),
        ("name", |g| g.name = "n".repeat(129)),
        ("log_key", |g| g.log_key = [0; 32]),
        ("min_improvement_bps", |g| g.rules.min_improvement_bps = 0),
        ("min_improvement_bps", |g| {
            g.rules.min_improvement_bps = 10_001
        }),
        ("min_eval_samples", |g| g.rules.min_eval_samples = 1),
        ("min_dataset_samples", |g| g.rules.min_dataset_samples = 0),
        ("evaluation_frames", |g| g.rules.evaluation_frames = 0),
        ("evaluation_frames", |g| g.rules.evaluation_frames = 9),
        ("evaluation_frames", |g| g.rules.evaluation_frames = 4097),
        ("shares", |g| {
            let max_of_median_bps = 9_999;
            g.rules.shares = Shares::Samples { max_of_median_bps };
        }),
        ("shares", |g| {
            let max_of_median_bps = 1_000_001;
            g.rules.shares = Shares::Samples { max_of_median_bps };
        }),
        ("submit_window_ms", |g| g.rules.submit_window_ms = 0),
        ("randomness_window_ms", |g| g.rules.randomness_window_ms = 0),
        ("witness_policy names no witnesses", |g| {
            g.rules.randomness = RandomnessSource::Witnesses
        }),
        ("is not a point of G2", |g| {
            let chain = DrandChain {
                public_key: [7; 96],
                ..DrandChain::quicknet()
            };
            g.rules.randomness = RandomnessSource::Drand(Box::new(chain))
        }),
        ("period_s is 0", |g| {
            let chain = DrandChain {
                period_s: 0,
                ..DrandChain::quicknet()
            };
            g.rules.randomness = RandomnessSource::Drand(Box::new(chain))
        }),
        ("randomness_window_ms is 63000", |g| {
            g.rules.randomness = RandomnessSource::Drand(Box::new(DrandChain::quicknet()));
            g.rules.randomness_window_ms = 63_000;
        }),
        ("margin_ms of 18446744073709551615", |g| {
            let chain = DrandChain {
                margin_ms: u64::MAX,
                ..DrandChain::quicknet()
            };
            g.rules.randomness = RandomnessSource::Drand(Box::new(chain));
            g.rules.randomness_window_ms = MAX_ROUND_WINDOW_MS;
        }),
        ("unanswered.max", |g| g.rules.unanswered.max = 99),
        ("recordings.fps is 0", |g| {
            g.rules.recordings.fps = Some(0);
        }),
        ("recordings.fps is 1001", |g| {
            g.rules.recordings.fps = Some(1001);
        }),
        ("recordings.joints has 65 names", |g| {
            g.rules.recordings.joints = vec!["joint".into(); 65];
        }),
        ("recordings.joints has a name (number 1", |g| {
            g.rules.recordings.joints = vec!["joint".into(), String::new()];
        }),
        ("recordings.cameras has a name (number 0", |g| {
            g.rules.recordings.cameras = vec!["n".repeat(129)];
        }),
        ("recordings.cameras names cameras twice", |g| {
            g.rules.recordings.cameras = vec!["top".into(), "top".into()];
        }),
    ];
    for (what, breaks) in broken {
        let mut genesis = genesis();
        breaks(&mut genesis);
        match State::found(&entry(T0, Body::Genesis(genesis))) {
            Err(RuleViolation::BadGenesis(why)) => assert!(why.contains(what), "{why}"),
            other => panic!("{what}: {other:?}"),
        }
    }
}

#[test]
fn rules_that_would_stop_a_network_for_ever_found_nothing() {
    type Change = fn(&mut Rules, u64);
    let bounds: [(&str, u64, Change); 9] = [
        ("commit_window_ms", MAX_ROUND_WINDOW_MS, |rules, value| {
            rules.commit_window_ms = value
        }),
        ("submit_window_ms", MAX_ROUND_WINDOW_MS, |rules, value| {
            rules.submit_window_ms = value
        }),
        (
            "randomness_window_ms",
            MAX_ROUND_WINDOW_MS,
            |rules, value| rules.randomness_window_ms = value,
        ),
        ("max_update_bytes", MAX_UPDATE_BYTES, |rules, value| {
            rules.max_update_bytes = value
        }),
        ("max_proof_bytes", MAX_PROOF_BYTES, |rules, value| {
            rules.max_proof_bytes = value
        }),
        (
            "credits.max_per_contribution",
            MAX_CREDITS,
            |rules, value| rules.credits.max_per_contribution = value,
        ),
        (
            "credits.dispute_window_ms",
            MAX_GOVERNANCE_WINDOW_MS,
            |rules, value| rules.credits.dispute_window_ms = value,
        ),
        (
            "governance.voting_ms",
            MAX_GOVERNANCE_WINDOW_MS,
            |rules, value| rules.governance.voting_ms = value,
        ),
        (
            "governance.time_lock_ms",
            MAX_GOVERNANCE_WINDOW_MS,
            |rules, value| rules.governance.time_lock_ms = value,
        ),
    ];
    for (rule, most, change) in bounds {
        let mut rules = genesis().rules;
        change(&mut rules, most);
        assert_eq!(rules.check(), Ok(()), "{rule}");
        for above in [most + 1, u64::MAX] {
            change(&mut rules, above);
            let why = format!("rule {rule} is {above}; it can be at most {most}");
            assert_eq!(rules.check(), Err(why));
        }
    }
}

/// An argument of mode `succinct` is about 256 samples at most.
#[test]
fn rules_that_no_node_of_the_mode_can_satisfy_found_nothing() {
    let found = |mode, max_eval_samples| {
        let mut genesis = genesis();
        genesis.mode = mode;
        genesis.rules.max_eval_samples = max_eval_samples;
        State::found(&entry(T0, Body::Genesis(genesis))).map(drop)
    };
    for (mode, most) in [(Mode::Direct, 4096), (Mode::Succinct, 256)] {
        assert_eq!(found(mode, most), Ok(()));
        let Err(RuleViolation::BadGenesis(why)) = found(mode, most + 1) else {
            panic!("{mode}: {} samples", most + 1);
        };
        let named = format!("rule max_eval_samples is {}", most + 1);
        assert!(why.contains(&named), "{why}");
        assert!(why.contains(&format!("at most {most}")), "{why}");
    }
}

#[test]
fn a_window_that_the_latest_beacon_fits_in_is_accepted() {
    let mut rules = genesis().rules;
    rules.randomness = RandomnessSource::Drand(Box::new(DrandChain::quicknet()));
    rules.randomness_window_ms = 63_001;
    assert_eq!(rules.check(), Ok(()));
    // Only a beacon's round has to fit in it.
    rules.randomness = RandomnessSource::LogVrf;
    rules.randomness_window_ms = 1;
    assert_eq!(rules.check(), Ok(()));
}

#[test]
fn the_network_id_is_that_of_the_whole_genesis() {
    let network = *Chain::new().state.network();
    let mut other = genesis();
    other.nonce[31] ^= 1;
    assert_ne!(network, other.network_id());
    let mut other = genesis();
    other.rules.max_proof_bytes += 1;
    assert_ne!(network, other.network_id());
}

#[test]
fn versions_are_known() {
    let mut unknown = entry(T0, Body::Genesis(genesis()));
    unknown.version = ENTRY_VERSION + 1;
    let expected = RuleViolation::Entry(EntryError::UnknownVersion(ENTRY_VERSION + 1));
    assert_eq!(State::found(&unknown), Err(expected.clone()));
    let mut unknown = entry(T0, enrolled(0));
    unknown.version = ENTRY_VERSION + 1;
    let mut state = Chain::new().state;
    assert_eq!(state.apply(&digest(0), &unknown), Err(expected));
}

#[test]
fn time_does_not_run_backwards() {
    let mut state = Chain::new().state;
    assert_eq!(
        state.apply(&digest(0), &entry(T0 - 1, enrolled(0))),
        Err(RuleViolation::TimeBackwards {
            time_ms: T0 - 1,
            last_ms: T0
        })
    );
    assert_eq!(state.apply(&digest(0), &entry(T0, enrolled(0))), Ok(()));
}

#[test]
fn nodes_enrol_once_under_a_real_key_and_a_plain_name() {
    let mut chain = Chain::new();
    chain.apply(enrolled(0));
    assert_eq!(
        chain.refusal(enrolled(0)),
        RuleViolation::AlreadyEnrolled(id(0))
    );
    let bad = |node: NodeId, name: &str| {
        Body::NodeEnrolled(NodeEnrolled {
            node,
            name: name.into(),
        })
    };
    // Zero is a point of small order, under which anyone can sign.
    for body in [
        bad(NodeId([0; 32]), "weak"),
        bad(id(1), ""),
        bad(id(1), "a\nb"),
        bad(id(1), &"n".repeat(129)),
    ] {
        assert!(matches!(chain.refusal(body), RuleViolation::BadNode { .. }));
    }
}

#[test]
fn rules_are_the_same_as_json() {
    let mut rules = genesis().rules;
    rules.participation = Participation::Listed(vec![id(0)]);
    rules.strategy = Strategy::TrimmedMean { trim_bps: 1000 };
    let json = serde_json::to_string_pretty(&rules).unwrap();
    assert_eq!(serde_json::from_str::<Rules>(&json).unwrap(), rules);
    let unknown = json.replace("min_dataset_samples", "min_dataset_sample");
    let error = serde_json::from_str::<Rules>(&unknown)
        .unwrap_err()
        .to_string();
    assert!(error.contains("min_dataset_sample"), "{error}");
}
