//! Checks a round's result in its closing: it is evaluated if the rules require it, and becomes the global weights if taken.
//! Auditors recompute the losses from blobs.

use crate::entries::entry::RoundClosed;
use crate::entries::round_result::{EvaluatedResult, ResultOutcome};
use crate::rules::closing::public_samples::PublicSamples;
use crate::rules::state::{Round, State};
use crate::rules::violation::RuleViolation;

impl State {
    pub(super) fn check_result(
        &self,
        round: &Round,
        closed: &RoundClosed,
    ) -> Result<(), RuleViolation> {
        let contributed = !closed.contributors.is_empty();
        let samples = self.rules.public_samples.filter(|_| contributed);
        match (samples, &closed.evaluated) {
            (None, None) if !contributed => kept(round, closed, "nobody contributed"),
            (None, None) => Ok(()),
            (Some(samples), Some(evaluated)) => check_evaluated(round, closed, &samples, evaluated),
            (None, Some(_)) => Err(wrong(
                closed,
                "evaluated",
                "an evaluation",
                "none, since nobody contributed, or the rules name no public samples",
            )),
            (Some(samples), None) => Err(wrong(
                closed,
                "evaluated",
                "none",
                &format!("an evaluation on the public samples {}", samples.blob),
            )),
        }
    }
}

fn check_evaluated(
    round: &Round,
    closed: &RoundClosed,
    samples: &PublicSamples,
    evaluated: &EvaluatedResult,
) -> Result<(), RuleViolation> {
    let outcome = samples.outcome(&evaluated.base, &evaluated.result);
    if evaluated.outcome != outcome {
        let why = format!(
            "{outcome:?}, since the base has {} and the result has {}",
            evaluated.base, evaluated.result
        );
        let found = format!("{:?}", evaluated.outcome);
        return Err(wrong(closed, "evaluated.outcome", &found, &why));
    }
    if outcome != ResultOutcome::Taken {
        return kept(round, closed, "the result was not taken");
    }
    if closed.global == evaluated.weights {
        Ok(())
    } else {
        Err(wrong(
            closed,
            "global",
            &format!("{:?}", closed.global),
            &format!("the result, which was taken: {:?}", evaluated.weights),
        ))
    }
}

fn kept(round: &Round, closed: &RoundClosed, why: &str) -> Result<(), RuleViolation> {
    let base = round.opened.base;
    if closed.global == base {
        Ok(())
    } else {
        Err(wrong(
            closed,
            "global",
            &format!("{:?}", closed.global),
            &format!("the base, since {why}: {base:?}"),
        ))
    }
}

fn wrong(closed: &RoundClosed, field: &'static str, found: &str, expected: &str) -> RuleViolation {
    RuleViolation::RoundField {
        round: closed.round,
        field,
        found: found.into(),
        expected: expected.into(),
    }
}
