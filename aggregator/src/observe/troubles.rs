//! What is wrong with a running aggregator, as far as it detects that itself. The tasks that meet a trouble raise and clear it. The status,
//! the metrics and the health checks show it.
//!
//! Strangers may ask for the status, so these sentences name no address, path or node. The log does.

use futures_util::FutureExt;
use std::collections::BTreeMap;
use std::future::Future;
use std::panic::{resume_unwind, AssertUnwindSafe};
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::watch;
use zk0_protocol::rpc::federation as proto;
use zk0_protocol::rpc::federation::trouble::Kind;

/// The troubles in force, by their kind. Clones share them.
#[derive(Clone, Default)]
pub struct Troubles(Arc<watch::Sender<BTreeMap<Kind, Trouble>>>);

/// Something that is wrong.
#[derive(Clone, Debug)]
pub struct Trouble {
    sentence: String,
    since: Instant,
}

impl Troubles {
    /// Raises trouble of this kind. Existing trouble gets a new sentence and keeps its age.
    pub fn raise(&self, kind: Kind, sentence: impl Into<String>) {
        let sentence = sentence.into();
        self.0.send_if_modified(|in_force| {
            let since = in_force.get(&kind).map(|trouble| trouble.since);
            let trouble = Trouble {
                sentence,
                since: since.unwrap_or_else(Instant::now),
            };
            in_force.insert(kind, trouble).is_none()
        });
    }

    /// Ends the trouble of this kind.
    pub fn clear(&self, kind: Kind) {
        self.0
            .send_if_modified(|in_force| in_force.remove(&kind).is_some());
    }

    /// Puts only this trouble, or none, in force among these kinds.
    pub fn only(&self, kinds: &[Kind], trouble: Option<(Kind, &str)>) {
        for kind in kinds {
            match trouble {
                Some((raised, sentence)) if raised == *kind => self.raise(raised, sentence),
                _ => self.clear(*kind),
            }
        }
    }

    /// How long this kind of trouble has lasted.
    pub fn lasting(&self, kind: Kind) -> Option<Duration> {
        let in_force = self.0.borrow();
        in_force.get(&kind).map(|trouble| trouble.since.elapsed())
    }

    /// All troubles, as the status has them.
    pub fn all(&self) -> Vec<proto::Trouble> {
        let in_force = self.0.borrow();
        let all = in_force.iter().map(|(kind, trouble)| proto::Trouble {
            kind: (*kind).into(),
            sentence: trouble.sentence.clone(),
            for_ms: u64::try_from(trouble.since.elapsed().as_millis()).unwrap_or(u64::MAX),
        });
        all.collect()
    }

    /// For those who wait until a kind comes or goes.
    pub fn follow(&self) -> watch::Receiver<BTreeMap<Kind, Trouble>> {
        self.0.subscribe()
    }

    /// Runs a task. A panic is logged, becomes trouble until the next start, and goes on.
    pub async fn supervised<T>(self, task: &'static str, work: impl Future<Output = T>) -> T {
        match AssertUnwindSafe(work).catch_unwind().await {
            Ok(done) => done,
            Err(panic) => {
                tracing::error!(
                    "{task} has panicked: start the aggregator again, and report the bug"
                );
                let sentence =
                    format!("{task} has panicked: the aggregator has to be started again");
                self.raise(Kind::Task, sentence);
                resume_unwind(panic)
            }
        }
    }
}

/// Whether the rounds or the log need the operator, for monitors.
pub fn stops_network(kind: Kind) -> bool {
    match kind {
        Kind::Blocked | Kind::Clock | Kind::Fork | Kind::Task | Kind::Overdue => true,
        // It ends when others answer again.
        Kind::LogStore
        | Kind::Witnesses
        | Kind::Beacon
        | Kind::BlobStore
        | Kind::WitnessAway
        | Kind::Unspecified => false,
    }
}

/// Whether requests should go elsewhere, for load balancers. While a round is blocked, members' messages are still recorded, and may end
/// the trouble.
pub fn stops_requests(kind: Kind) -> bool {
    match kind {
        // It records nothing, or it may be a copy that signs a second history.
        Kind::Clock | Kind::Fork | Kind::BlobStore => true,
        Kind::Blocked
        | Kind::Task
        | Kind::LogStore
        | Kind::Witnesses
        | Kind::Beacon
        | Kind::WitnessAway
        | Kind::Overdue
        | Kind::Unspecified => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kinds(troubles: &Troubles) -> Vec<Kind> {
        troubles.all().iter().map(proto::Trouble::kind).collect()
    }

    #[test]
    fn a_trouble_keeps_its_age_until_it_is_cleared() {
        let troubles = Troubles::default();
        assert_eq!(troubles.lasting(Kind::Blocked), None);
        troubles.raise(Kind::Blocked, "round 1 cannot close");
        let begun = troubles.follow().borrow()[&Kind::Blocked].since;
        troubles.raise(
            Kind::Blocked,
            "round 1 cannot close, and neither can round 2",
        );
        let again = troubles.follow().borrow()[&Kind::Blocked].clone();
        assert_eq!(again.since, begun);
        assert!(again.sentence.ends_with("round 2"), "{again:?}");
        assert!(troubles.lasting(Kind::Blocked).is_some());
        troubles.clear(Kind::Blocked);
        assert!(troubles.all().is_empty());
    }

    #[test]
    fn one_task_clears_only_its_own_kinds() {
        let troubles = Troubles::default();
        let of_rounds = [Kind::Blocked, Kind::Clock];
        troubles.raise(Kind::Fork, "");
        troubles.only(&of_rounds, Some((Kind::Clock, "")));
        assert_eq!(kinds(&troubles), [Kind::Clock, Kind::Fork]);
        troubles.only(&of_rounds, Some((Kind::Blocked, "")));
        assert_eq!(kinds(&troubles), [Kind::Blocked, Kind::Fork]);
        troubles.only(&of_rounds, None);
        assert_eq!(kinds(&troubles), [Kind::Fork]);
    }

    #[test]
    fn those_who_follow_hear_what_comes_and_goes() {
        let troubles = Troubles::default();
        let mut followed = troubles.follow();
        let mut heard = || {
            let news = followed.has_changed().unwrap();
            followed.mark_unchanged();
            news
        };
        assert!(!heard());
        troubles.clear(Kind::Task);
        assert!(!heard());
        troubles.raise(Kind::Task, "");
        assert!(heard());
        troubles.raise(Kind::Task, "another");
        assert!(!heard());
        troubles.clear(Kind::Task);
        assert!(heard());
    }

    #[tokio::test]
    async fn a_task_that_panics_is_trouble_and_one_that_ends_is_none() {
        let troubles = Troubles::default();
        let ends = troubles.clone().supervised("a task", async { 1 });
        assert_eq!(tokio::spawn(ends).await.unwrap(), 1);
        let aborted = tokio::spawn(
            troubles
                .clone()
                .supervised("a task", std::future::pending::<()>()),
        );
        aborted.abort();
        assert!(aborted.await.unwrap_err().is_cancelled());
        assert!(troubles.all().is_empty());
        let panics = troubles
            .clone()
            .supervised("a task", async { panic!("on purpose") });
        assert!(tokio::spawn(panics).await.unwrap_err().is_panic());
        assert_eq!(kinds(&troubles), [Kind::Task]);
        assert!(troubles.all()[0]
            .sentence
            .starts_with("a task has panicked"));
    }

    #[test]
    fn what_others_may_mend_takes_no_service_away() {
        let chosen =
            |stops: fn(Kind) -> bool| Kind::ALL.into_iter().filter(move |kind| stops(*kind));
        let network = [
            Kind::Blocked,
            Kind::Clock,
            Kind::Fork,
            Kind::Task,
            Kind::Overdue,
        ];
        assert!(chosen(stops_network).eq(network));
        let requests = [Kind::Clock, Kind::Fork, Kind::BlobStore];
        assert!(chosen(stops_requests).eq(requests));
    }
}
