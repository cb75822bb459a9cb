//! What a node shows its operator.

use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use std::sync::Arc;
use zk0_protocol::Refusal;
use zk0_service::metrics::endpoint::ObservedService;
use zk0_service::metrics::registry::{gauged, now_s, MetricRegistry};
use zk0_service::metrics::troubles::ServiceTroubles;

type Labelled<V, M> = Family<[(&'static str, V); 1], M>;

/// What a node is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NodePhase {
    /// It opens its recording, and registers it.
    Preparing,
    /// It waits for a round.
    Waiting,
    /// It trains.
    Training,
    /// It uploads its update, commits to it, and waits for the challenge.
    Committing,
    /// It makes the claim and has it proven.
    Proving,
    /// It submits the proof.
    Submitting,
    /// It waits until the round has closed.
    Closing,
}

impl NodePhase {
    const ALL: [Self; 7] = [
        Self::Preparing,
        Self::Waiting,
        Self::Training,
        Self::Committing,
        Self::Proving,
        Self::Submitting,
        Self::Closing,
    ];

    fn name(self) -> &'static str {
        match self {
            Self::Preparing => "preparing",
            Self::Waiting => "waiting",
            Self::Training => "training",
            Self::Committing => "committing",
            Self::Proving => "proving",
            Self::Submitting => "submitting",
            Self::Closing => "closing",
        }
    }
}

/// Whom a node asks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AskedService {
    /// The aggregator.
    Aggregator,
    /// The proving service.
    Prover,
}

impl AskedService {
    const ALL: [Self; 2] = [Self::Aggregator, Self::Prover];

    fn name(self) -> &'static str {
        match self {
            Self::Aggregator => "aggregator",
            Self::Prover => "prover",
        }
    }
}

/// The kind of trouble of a node that lacks the network's guest program.
const PROGRAM: &str = "program";

/// The metrics of a node. Clones count together.
#[derive(Clone)]
pub struct NodeMetrics {
    observed: ObservedService,
    phase: Labelled<&'static str, Gauge>,
    round: Gauge,
    rounds: Labelled<&'static str, Counter>,
    accepted: Gauge,
    refusals: Labelled<u8, Counter>,
    repeated: Labelled<&'static str, Counter>,
}

impl Default for NodeMetrics {
    fn default() -> Self {
        let mut registry = MetricRegistry::default();
        let [aggregator, prover] = AskedService::ALL.map(AskedService::name);
        let troubles = ServiceTroubles::registered(&mut registry, &[aggregator, prover, PROGRAM]);
        let (phase, rounds) = (Labelled::default(), Labelled::default());
        let (refusals, repeated) = (Labelled::default(), Labelled::default());
        let (round, accepted) = (Gauge::default(), Gauge::default());
        registry.register("node_phase", "1 for what the node is doing", phase.clone());
        registry.register(
            "node_round",
            "The round that the node took part in last",
            round.clone(),
        );
        registry.register(
            "node_rounds",
            "Rounds of the node, by what became of its contribution",
            rounds.clone(),
        );
        registry.register(
            "node_accepted_timestamp_seconds",
            "When a contribution was accepted last, in Unix seconds; 0 before the first",
            accepted.clone(),
        );
        registry.register(
            "node_refusals",
            "Contributions that were refused, by the number of the code",
            refusals.clone(),
        );
        registry.register(
            "node_repeated_requests",
            "Requests that the node repeats after a failure, by whom it asks",
            repeated.clone(),
        );
        let registry = Arc::new(registry);
        let new = Self {
            observed: ObservedService { registry, troubles },
            phase,
            round,
            rounds,
            accepted,
            refusals,
            repeated,
        };
        for outcome in ["accepted", "refused", "missed"] {
            drop(new.rounds.get_or_create(&[("outcome", outcome)]));
        }
        for asked in AskedService::ALL {
            drop(new.repeated.get_or_create(&[("asked", asked.name())]));
        }
        new.enters(NodePhase::Preparing);
        new
    }
}

impl NodeMetrics {
    /// What the node's operator sees.
    pub fn observed(&self) -> &ObservedService {
        &self.observed
    }

    /// From now on, the node is doing this.
    pub(crate) fn enters(&self, now: NodePhase) {
        for phase in NodePhase::ALL {
            let gauge = self.phase.get_or_create(&[("phase", phase.name())]);
            gauge.set((phase == now).into());
        }
    }

    /// The node takes part in this round.
    pub(crate) fn begins(&self, round: u64) {
        self.round.set(gauged(round));
    }

    /// The node has taken part in a round. Its contribution was refused, if there is a refusal, or accepted.
    pub(crate) fn decided(&self, refusal: Option<&Refusal>) {
        match refusal {
            None => {
                self.ended("accepted");
                self.accepted.set(now_s());
            }
            Some(refusal) => {
                self.ended("refused");
                let label = [("code", refusal.code.number())];
                self.refusals.get_or_create(&label).inc();
            }
        }
    }

    /// The node has contributed nothing to a round.
    pub(crate) fn missed(&self) {
        self.ended("missed");
    }

    /// The node will ask again, because it did not get what it asked for.
    pub(crate) fn asks_again(&self, asked: AskedService, why: String) {
        let label = [("asked", asked.name())];
        self.repeated.get_or_create(&label).inc();
        self.observed.troubles.raise(asked.name(), why);
    }

    /// The node got what it asked for.
    pub(crate) fn answered(&self, asked: AskedService) {
        self.observed.troubles.clear(asked.name());
    }

    /// The node waits, because it lacks the network's guest program.
    pub(crate) fn lacks_program(&self, why: String) {
        self.observed.troubles.raise(PROGRAM, why);
    }

    /// The node has the network's guest program.
    pub(crate) fn has_program(&self) {
        self.observed.troubles.clear(PROGRAM);
    }

    fn ended(&self, outcome: &'static str) {
        self.rounds.get_or_create(&[("outcome", outcome)]).inc();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use zk0_protocol::RefusalCode;

    #[test]
    fn rounds_are_counted_by_what_became_of_them() {
        let metrics = NodeMetrics::default();
        let shows = |line: &str| metrics.observed.registry.text().unwrap().contains(line);
        assert!(shows("zk0_node_accepted_timestamp_seconds 0\n"));
        metrics.decided(None);
        metrics.decided(Some(&RefusalCode::InvalidProof.into()));
        metrics.missed();
        for outcome in ["accepted", "refused", "missed"] {
            assert!(shows(&format!(
                "zk0_node_rounds_total{{outcome=\"{outcome}\"}} 1\n"
            )));
        }
        let number = RefusalCode::InvalidProof.number();
        assert!(shows(&format!(
            "zk0_node_refusals_total{{code=\"{number}\"}} 1\n"
        )));
        assert!(!shows("zk0_node_accepted_timestamp_seconds 0\n"));
    }

    #[test]
    fn a_node_that_lacks_the_program_is_in_trouble_until_it_has_it() {
        let metrics = NodeMetrics::default();
        let shows = |line: &str| metrics.observed.registry.text().unwrap().contains(line);
        assert!(shows("zk0_trouble{kind=\"program\"} 0\n"));
        metrics.lacks_program("the node lacks it".into());
        assert!(shows("zk0_trouble{kind=\"program\"} 1\n"));
        assert_eq!(metrics.observed.troubles.sentences(), ["the node lacks it"]);
        metrics.has_program();
        assert!(shows("zk0_trouble{kind=\"program\"} 0\n"));
    }

    #[test]
    fn a_node_is_in_one_phase() {
        let metrics = NodeMetrics::default();
        metrics.enters(NodePhase::Proving);
        let text = metrics.observed.registry.text().unwrap();
        assert_eq!(text.matches("zk0_node_phase{").count(), 7);
        let proving = "zk0_node_phase{phase=\"proving\"} 1\n";
        assert!(text.contains(proving), "{text}");
        assert_eq!(text.matches("\"} 1\n").count(), 2, "{text}");
    }
}
