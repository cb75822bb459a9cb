//! Counts the outcomes of rounds and contributions since the start.

use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use zk0_protocol::entries::entry::RoundClosed;
use zk0_protocol::RefusalCode;
use zk0_service::metrics::registry::MetricRegistry;

type Counts<V> = Family<[(&'static str, V); 1], Counter>;

#[derive(Clone, Default)]
pub(crate) struct OutcomeMetrics {
    rounds: Counts<&'static str>,
    commitments: Counts<&'static str>,
    refusals: Counts<u8>,
}

impl OutcomeMetrics {
    pub fn registered(registry: &mut MetricRegistry) -> Self {
        let new = Self::default();
        registry.register(
            "rounds",
            "Rounds that have closed, by what became of their result",
            new.rounds.clone(),
        );
        registry.register(
            "commitments",
            "Commitments of closed rounds that ended with an accepted contribution, or without an answer to the challenge",
            new.commitments.clone(),
        );
        registry.register(
            "refusals",
            "Contributions whose refusal was recorded, by the number of its code",
            new.refusals.clone(),
        );
        // An alarm on a counter needs its value from before the first event.
        for outcome in ["taken", "kept", "empty"] {
            drop(new.rounds.get_or_create(&[("outcome", outcome)]));
        }
        for ended in ["accepted", "unanswered"] {
            drop(new.commitments.get_or_create(&[("ended", ended)]));
        }
        new
    }

    pub fn closed(&self, round: &RoundClosed) {
        let outcome = if round.contributors.is_empty() {
            "empty"
        } else if round.is_taken() {
            "taken"
        } else {
            "kept"
        };
        self.rounds.get_or_create(&[("outcome", outcome)]).inc();
        let ended = |how, nodes: usize| {
            let counter = self.commitments.get_or_create(&[("ended", how)]);
            counter.inc_by(nodes as u64);
        };
        ended("accepted", round.contributors.len());
        ended("unanswered", round.unanswered.len());
    }

    pub fn refused(&self, code: RefusalCode) {
        let label = [("code", code.number())];
        self.refusals.get_or_create(&label).inc();
    }
}
