//! A round by FedAdam ends with moments. The ledger names them before it closes, and the next round goes on from them.

use zk0_protocol::entries::entry::{MomentsComputed, RoundClosed};
use zk0_protocol::rules::closing::server_moments::ServerMoments;
use zk0_protocol::rules::named_blobs::{named_blobs, BlobKind, NamedBlob};
use zk0_protocol::rules::network_rules::Strategy;
use zk0_protocol::{Body, RuleViolation};
use zk0_testkit::network::*;

const FED_ADAM: Strategy = Strategy::FedAdam {
    server_rate_billionths: 1_000_000,
    beta1_bps: 9000,
    beta2_bps: 9900,
    tau_billionths: 1_000_000,
};

/// A network of one node that combines by this strategy.
fn network(strategy: Strategy) -> Chain {
    let mut founded = genesis();
    founded.rules.strategy = strategy;
    founded.rules.public_samples = Some(PUBLIC_SAMPLES);
    let mut chain = Chain::founded(founded);
    chain.apply(enrolled(0));
    chain.apply(registered(&chain.state.network().clone(), 0));
    chain
}

trait Contributed {
    /// Opens a round in which node 0 contributes.
    fn contributed(&mut self, update: u8);
}

impl Contributed for Chain {
    fn contributed(&mut self, update: u8) {
        self.open();
        self.apply(committed(&self.state, 0, weights(update)));
        self.draw();
        self.apply(accepted(&self.state, 0));
    }
}

fn computed(chain: &Chain, moments: u8) -> Body {
    Body::MomentsComputed(MomentsComputed {
        round: chain.state.next_round() - 1,
        moments: digest(moments),
    })
}

fn taken(chain: &Chain) -> RoundClosed {
    closed(&chain.state, weights(0x50))
}

fn refused_moments(chain: &mut Chain, body: Body) -> String {
    match chain.refusal(body) {
        RuleViolation::RoundField {
            field: "moments",
            expected,
            ..
        } => expected,
        other => panic!("{other}"),
    }
}

#[test]
fn a_round_goes_on_from_the_moments_of_the_last_one() {
    let mut chain = network(FED_ADAM);
    assert_eq!(chain.state.moments(), None, "they begin afresh");
    for (round, steps) in [(1, 1), (2, 2)] {
        chain.contributed(0x10 + round);
        let before = chain.state.moments().copied();
        let body = computed(&chain, 0x30 + round);
        let expected = NamedBlob {
            digest: digest(0x30 + round),
            kind: BlobKind::Moments,
        };
        assert_eq!(named_blobs(&body), [expected]);
        chain.apply(body);
        assert_eq!(chain.state.moments().copied(), before, "until the closing");
        let closing = taken(&chain);
        chain.apply(Body::RoundClosed(closing));
        let blob = digest(0x30 + round);
        let expected = ServerMoments { blob, steps };
        assert_eq!(chain.state.moments(), Some(&expected));
    }
}

#[test]
fn a_round_by_fed_adam_cannot_close_without_its_moments() {
    let mut chain = network(FED_ADAM);
    chain.contributed(0x10);
    let closing = Body::RoundClosed(taken(&chain));
    let expected = refused_moments(&mut chain, closing.clone());
    assert!(expected.contains("fed-adam"), "{expected}");
    chain.apply(computed(&chain, 0x30));
    chain.apply(closing);
}

#[test]
fn moments_are_named_once_and_only_when_the_round_may_close() {
    let mut chain = network(FED_ADAM);
    let early = |chain: &mut Chain| {
        let body = computed(chain, 0x30);
        let violation = chain.refusal(body);
        assert!(
            matches!(violation, RuleViolation::ClosedEarly { .. }),
            "{violation}"
        );
    };
    chain.open();
    early(&mut chain);
    chain.apply(committed(&chain.state, 0, weights(0x10)));
    early(&mut chain);
    chain.draw();
    early(&mut chain);
    chain.apply(accepted(&chain.state, 0));
    let other = Body::MomentsComputed(MomentsComputed {
        round: 7,
        moments: digest(1),
    });
    assert_eq!(chain.refusal(other), RuleViolation::RoundNotOpen(7));
    chain.apply(computed(&chain, 0x30));
    let body = computed(&chain, 0x31);
    let again = refused_moments(&mut chain, body);
    assert!(again.contains("already"), "{again}");
    let closing = taken(&chain);
    chain.apply(Body::RoundClosed(closing));
    let body = computed(&chain, 0x30);
    let violation = chain.refusal(body);
    assert_eq!(violation, RuleViolation::RoundNotOpen(0));
}

#[test]
fn other_strategies_and_rounds_without_contributors_have_no_moments() {
    let mut chain = network(Strategy::FedAvg);
    chain.contributed(0x10);
    let body = computed(&chain, 0x30);
    let expected = refused_moments(&mut chain, body);
    assert!(expected.contains("not fed-adam"), "{expected}");
    let mut chain = network(FED_ADAM);
    chain.open();
    chain.close_commitments();
    let body = computed(&chain, 0x30);
    let expected = refused_moments(&mut chain, body);
    assert!(expected.contains("nobody contributed"), "{expected}");
    chain.close(weights(4));
}

#[test]
fn a_round_that_keeps_its_base_keeps_its_moments() {
    let mut chain = network(FED_ADAM);
    chain.contributed(0x10);
    chain.apply(computed(&chain, 0x30));
    let closing = taken(&chain);
    chain.apply(Body::RoundClosed(closing));
    let moments = *chain.state.moments().unwrap();
    // What was not taken must not move later rounds.
    chain.contributed(0x11);
    let closing = Body::RoundClosed(kept(&chain.state, weights(0x51)));
    let mut with_moments = chain.state.clone();
    let body = computed(&chain, 0x31);
    let entry_of = |body| entry(chain.time_ms + 1, body);
    with_moments.apply(&digest(0), &entry_of(body)).unwrap();
    let violation = with_moments.apply(&digest(0), &entry_of(closing.clone()));
    let violation = violation.unwrap_err().to_string();
    assert!(violation.contains("was not taken"), "{violation}");
    chain.apply(closing);
    assert_eq!(chain.state.moments(), Some(&moments));
    // Nor does a round without contributors.
    chain.open();
    let base = *chain.state.global();
    chain.close(base);
    assert_eq!(chain.state.moments(), Some(&moments));
}
