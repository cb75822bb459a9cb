//! The losses of each round's base weights on the node's own samples. The node's learning rate follows them.

use crate::error::ParticipantError;
use crate::state_files::{self, broken};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use zk0_circuits::Digest;

/// Room for more rounds than a network will have.
const MAX_BYTES: u64 = 64 << 20;

#[derive(Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct SavedLosses {
    network: String,
    /// Of the samples measured on.
    dataset: String,
    /// Oldest first.
    rounds: Vec<Measured>,
}

#[derive(Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Measured {
    round: u64,
    base: String,
    /// An `f32`, which JSON gives back exactly.
    loss: f32,
}

/// The losses of one node in one network.
pub struct BaseLosses {
    path: PathBuf,
    network: Digest,
    dataset: Digest,
}

impl BaseLosses {
    /// The losses in the state folder `state`, on the samples with the digest `dataset`.
    pub fn at(state: &Path, network: Digest, dataset: Digest) -> Self {
        Self {
            path: state.join("base-losses.json"),
            network,
            dataset,
        }
    }

    /// The losses up to `round`, the oldest first, which are on disk when this returns. `base` is the digest of `round`'s base weights,
    /// whose loss `measure` measures unless the file has it already.
    ///
    /// # Errors
    /// Those of `measure`. The file cannot be read or written, or belongs to another network, dataset or history.
    pub fn up_to(
        &self,
        round: u64,
        base: &Digest,
        measure: impl FnOnce() -> Result<f64, ParticipantError>,
    ) -> Result<Vec<f64>, ParticipantError> {
        let mut kept = self.kept()?;
        match kept.rounds.last() {
            Some(last) if last.round > round => {
                let why = format!(
                    "it goes up to round {}, but the network is in round {round}",
                    last.round
                );
                return Err(broken(&self.path, why));
            }
            Some(last) if last.round == round => {
                if last.base != base.to_string() {
                    let why = format!(
                        "it states that round {round} begins with weights {}, but the round begins with {base}",
                        last.base
                    );
                    return Err(broken(&self.path, why));
                }
            }
            _ => {
                let loss = measure()? as f32;
                if !is_loss(loss) {
                    return Err(ParticipantError::BaseLoss { round, loss });
                }
                kept.rounds.push(Measured {
                    round,
                    base: base.to_string(),
                    loss,
                });
                state_files::write_json(&self.path, &kept)?;
            }
        }
        Ok(kept.rounds.iter().map(|one| f64::from(one.loss)).collect())
    }

    fn kept(&self) -> Result<SavedLosses, ParticipantError> {
        let (network, dataset) = (self.network.to_string(), self.dataset.to_string());
        let Some(kept) = state_files::read_json::<SavedLosses>(&self.path, MAX_BYTES)? else {
            return Ok(SavedLosses {
                network,
                dataset,
                rounds: Vec::new(),
            });
        };
        let wrong = |why: String| Err(broken(&self.path, why));
        if kept.network != network {
            return wrong(format!("it belongs to network {}", kept.network));
        }
        if kept.dataset != dataset {
            return wrong(format!(
                "it is about samples whose digest is {}, and those of this node have the digest {dataset}",
                kept.dataset
            ));
        }
        if !kept.rounds.is_sorted_by(|one, next| one.round < next.round) {
            return wrong("its rounds are not in order".into());
        }
        match kept.rounds.iter().find(|one| !is_loss(one.loss)) {
            Some(one) => wrong(format!("the loss of round {} is {}", one.round, one.loss)),
            None => Ok(kept),
        }
    }
}

fn is_loss(loss: f32) -> bool {
    loss.is_finite() && loss >= 0.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    const BASE: Digest = Digest([7; 32]);

    fn losses(dir: &tempfile::TempDir) -> BaseLosses {
        BaseLosses::at(dir.path(), Digest([1; 32]), Digest([2; 32]))
    }

    fn not_again() -> Result<f64, ParticipantError> {
        panic!("it is measured already")
    }

    #[test]
    fn losses_are_measured_once_and_come_back_exactly() {
        let dir = tempfile::tempdir().unwrap();
        // No short decimal form.
        let first = losses(&dir).up_to(3, &BASE, || Ok(1.0 / 3.0)).unwrap();
        assert_eq!(first, [f64::from(1.0f32 / 3.0)]);
        assert_eq!(losses(&dir).up_to(3, &BASE, not_again).unwrap(), first);
        let both = losses(&dir).up_to(5, &BASE, || Ok(0.1)).unwrap();
        assert_eq!(both, [first[0], f64::from(0.1f32)]);
        for _ in 0..3 {
            assert_eq!(losses(&dir).up_to(5, &BASE, not_again).unwrap(), both);
        }
    }

    #[test]
    fn a_file_of_something_else_is_an_error() {
        let dir = tempfile::tempdir().unwrap();
        losses(&dir).up_to(3, &BASE, || Ok(0.5)).unwrap();
        let refused = |losses: &BaseLosses, round, base| {
            let error = losses.up_to(round, &base, || Ok(0.5)).unwrap_err();
            assert!(error.to_string().contains("base-losses.json"), "{error}");
            error.to_string()
        };
        let of = |network, dataset| BaseLosses::at(dir.path(), Digest(network), Digest(dataset));
        assert!(refused(&of([9; 32], [2; 32]), 4, BASE).contains("to network 0101"));
        assert!(refused(&of([1; 32], [9; 32]), 4, BASE).contains("whose digest is 0202"));
        assert!(refused(&losses(&dir), 2, BASE).contains("up to round 3"));
        assert!(refused(&losses(&dir), 3, Digest([8; 32])).contains("round 3 begins with"));

        let path = dir.path().join("base-losses.json");
        let text = fs::read_to_string(&path).unwrap();
        for (broken, why) in [
            (text.replace("0.5", "-0.5"), "the loss of round 3 is -0.5"),
            (text.replace("0.5", "1e39"), "the loss of round 3 is inf"),
            (text.replace("0.5", "null"), "invalid type"),
            (text.replace("\"loss\"", "\"lost\""), "unknown field"),
            (text[..text.len() - 1].into(), "EOF"),
        ] {
            fs::write(&path, &broken).unwrap();
            let reported = refused(&losses(&dir), 4, BASE);
            assert!(
                reported.contains(why) && reported.contains("move it away"),
                "{reported}"
            );
        }
        let entry = text.split('[').nth(1).unwrap().split(']').next().unwrap();
        fs::write(&path, text.replace(entry, &format!("{entry},{entry}"))).unwrap();
        assert!(refused(&losses(&dir), 4, BASE).contains("not in order"));
    }

    #[test]
    fn what_cannot_be_measured_is_not_kept() {
        let dir = tempfile::tempdir().unwrap();
        let error = losses(&dir).up_to(0, &BASE, || Ok(f64::NAN)).unwrap_err();
        assert!(error.to_string().contains("is NaN"), "{error}");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
    }
}
