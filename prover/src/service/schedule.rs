//! The order and duration of proofs, for waiting clients.
//!
//! Proving time is about `fixed + cycles / rate`: recursion to one proof costs the same for any small program. The constants are measured
//! on two cores (docs/prove.md, "How long does it take?"). Each proof's real time then scales them.

use prometheus_client::metrics::gauge::Gauge;
use std::collections::VecDeque;
use std::time::{Duration, Instant};
use zk0_service::metrics::registry::gauged;

/// Seconds to prove an empty program: start and recursion.
const FIXED_SECONDS: f64 = 300.0;
/// Further cycles proven per second.
const CYCLES_PER_SECOND: f64 = 12_000.0;
/// Seconds to start SP1.
const START_SECONDS: f64 = 70.0;
/// The cores of these measurements.
const CORES: f64 = 2.0;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Work {
    Start,
    /// A proof of this many guest cycles.
    Proof {
        cycles: u64,
    },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct QueuePosition(u64);

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Outlook {
    pub ahead: u32,
    /// Time from now until this place's work is done.
    pub remaining: Duration,
}

struct Job {
    place: QueuePosition,
    work: Work,
    began: Option<Instant>,
}

/// The speed of proofs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pace {
    /// The constants' time, multiplied by this.
    Scaled(f64),
    /// Unknown. After this time a proof is there, or has failed.
    AtMost(Duration),
}

impl Pace {
    /// The pace of a machine with `cores` hardware threads.
    pub fn of_cores(cores: usize) -> Self {
        Self::Scaled(CORES / cores.max(1) as f64)
    }

    fn expects(self, work: Work) -> Duration {
        match (self, work) {
            (Self::Scaled(scale), work) => Duration::from_secs_f64(expected(work) * scale),
            (Self::AtMost(most), Work::Proof { .. }) => most,
            (Self::AtMost(_), Work::Start) => Duration::ZERO,
        }
    }
}

#[derive(Clone, Default)]
pub struct QueueGauges {
    pub waiting: Gauge,
    pub proving: Gauge,
}

/// The caller supplies the clock.
pub struct ProofQueue {
    gauges: QueueGauges,
    pace: Pace,
    next: u64,
    jobs: VecDeque<Job>,
}

impl ProofQueue {
    pub fn new(pace: Pace) -> Self {
        Self {
            gauges: QueueGauges::default(),
            pace,
            next: 0,
            jobs: VecDeque::new(),
        }
    }

    pub fn counted(mut self, gauges: QueueGauges) -> Self {
        self.gauges = gauges;
        self
    }

    fn count(&self) {
        let proofs = self.jobs.iter().filter(|job| job.work != Work::Start);
        let (proving, waiting): (Vec<_>, Vec<_>) = proofs.partition(|job| job.began.is_some());
        self.gauges.proving.set(gauged(proving.len() as u64));
        self.gauges.waiting.set(gauged(waiting.len() as u64));
    }

    pub fn join(&mut self, work: Work) -> QueuePosition {
        let place = QueuePosition(self.next);
        self.next += 1;
        self.jobs.push_back(Job {
            place,
            work,
            began: None,
        });
        self.count();
        place
    }

    pub fn begin(&mut self, place: QueuePosition, now: Instant) {
        if let Some(job) = self.jobs.iter_mut().find(|job| job.place == place) {
            job.began = Some(now);
        }
        self.count();
    }

    /// Leaves the queue after success, failure, or giving up.
    pub fn leave(&mut self, place: QueuePosition) {
        self.jobs.retain(|job| job.place != place);
        self.count();
    }

    /// Leaves the queue after the work. Returns its time, which scales later estimates.
    pub fn finish(&mut self, place: QueuePosition, now: Instant) -> Duration {
        let job = self.jobs.iter().find(|job| job.place == place);
        let took = match job.and_then(|job| Some((job.work, job.began?))) {
            Some((work, began)) => {
                let took = now.saturating_duration_since(began);
                if let Work::Proof { .. } = work {
                    self.pace = Pace::Scaled(took.as_secs_f64() / expected(work));
                }
                took
            }
            None => Duration::ZERO,
        };
        self.leave(place);
        took
    }

    /// The work before `place`; empty after it left the queue.
    pub fn outlook(&self, place: QueuePosition, now: Instant) -> Outlook {
        let mut outlook = Outlook::default();
        for job in &self.jobs {
            let whole = self.pace.expects(job.work);
            let spent = job
                .began
                .map_or(Duration::ZERO, |began| now.saturating_duration_since(began));
            outlook.remaining += whole.saturating_sub(spent);
            if job.place == place {
                return outlook;
            }
            outlook.ahead += u32::from(job.work != Work::Start);
        }
        Outlook::default()
    }
}

/// Seconds of `work` on `cores` hardware threads.
pub fn expected_on(cores: usize, work: Work) -> f64 {
    Pace::of_cores(cores).expects(work).as_secs_f64()
}

/// Seconds of `work` where the constants were measured.
fn expected(work: Work) -> f64 {
    match work {
        Work::Start => START_SECONDS,
        Work::Proof { cycles } => FIXED_SECONDS + cycles as f64 / CYCLES_PER_SECOND,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: Duration = Duration::from_secs(1);

    #[test]
    fn those_who_wait_are_told_of_all_that_comes_first() {
        let mut schedule = ProofQueue::new(Pace::of_cores(2));
        let now = Instant::now();
        let start = schedule.join(Work::Start);
        schedule.begin(start, now);
        let work = Work::Proof { cycles: 1_800_000 };
        let (first, second) = (schedule.join(work), schedule.join(work));
        let later = now + 40 * SECOND;
        let outlook = |schedule: &ProofQueue, place| schedule.outlook(place, later);
        assert_eq!(
            outlook(&schedule, first),
            Outlook {
                ahead: 0,
                remaining: (30 + 450) * SECOND
            }
        );
        assert_eq!(
            outlook(&schedule, second),
            Outlook {
                ahead: 1,
                remaining: (30 + 900) * SECOND
            }
        );
        schedule.finish(start, later);
        schedule.leave(first);
        assert_eq!(
            outlook(&schedule, second),
            Outlook {
                ahead: 0,
                remaining: 450 * SECOND
            }
        );
    }

    #[test]
    fn the_first_proof_teaches_the_speed_of_the_machine() {
        let mut schedule = ProofQueue::new(Pace::of_cores(2));
        let now = Instant::now();
        let work = Work::Proof { cycles: 1_800_000 };
        let first = schedule.join(work);
        schedule.begin(first, now);
        let took = schedule.finish(first, now + 160 * SECOND);
        assert_eq!(took, 160 * SECOND);
        let second = schedule.join(work);
        assert_eq!(schedule.outlook(second, now).remaining, 160 * SECOND);
    }

    #[test]
    fn a_pace_that_nobody_knows_is_told_as_the_latest_time_until_there_is_a_proof() {
        let hour = 3600 * SECOND;
        let mut schedule = ProofQueue::new(Pace::AtMost(hour));
        let now = Instant::now();
        schedule.join(Work::Start);
        let work = Work::Proof { cycles: 1_800_000 };
        let first = schedule.join(work);
        let second = schedule.join(work);
        assert_eq!(schedule.outlook(first, now).remaining, hour);
        assert_eq!(schedule.outlook(second, now).remaining, 2 * hour);
        schedule.begin(first, now);
        schedule.finish(first, now + 90 * SECOND);
        schedule.begin(second, now);
        assert_eq!(schedule.outlook(second, now + 30 * SECOND).ahead, 0);
    }

    #[test]
    fn a_proof_that_takes_longer_than_expected_is_about_to_end() {
        let mut schedule = ProofQueue::new(Pace::of_cores(2));
        let now = Instant::now();
        let place = schedule.join(Work::Proof { cycles: 0 });
        schedule.begin(place, now);
        let outlook = schedule.outlook(place, now + 10_000 * SECOND);
        assert_eq!(outlook.remaining, Duration::ZERO);
    }
}
