//! Compares the ledger with what witnesses have cosigned: an earlier state of the folder, or a second copy of it, must publish nothing.

use super::log_store::OtherHistory;
use anyhow::{anyhow, bail, Context, Result};
use std::future;
use std::sync::Arc;
use std::time::Duration;
use tokio::task::spawn_blocking;
use tokio::time::sleep;
use zk0_aggregator::publish::cosigning::{ConsistencyProver, CosigningError, Witnesses};
use zk0_aggregator::Service;
use zk0_protocol::counted::counted;
use zk0_protocol::WitnessPolicy;

/// How often it is looked whether a witness is to be asked again, or contradicts.
const APART: Duration = Duration::from_millis(250);

/// What the operator knows of the ledger and of the witnesses.
#[derive(Debug, clap::Args)]
pub struct WitnessCheckOptions {
    /// Start although no witness answers, so that a vote can name others. Use this only if you know that the newest checkpoint that the log
    /// has signed is of SIZE entries. The ledger must have as many. This is for one start, so a settings file cannot have it.
    #[arg(long, value_name = "SIZE")]
    newest_checkpoint: Option<u64>,
    /// Start although this witness of the policy has cosigned other entries, or more. Use this only if you know that the ledger is the newest
    /// one and that no other aggregator runs on a copy, so that the witness is wrong: it has cosigned a thief's log, for example. Repeat the
    /// option for more. The others have to be a quorum, unless --newest-checkpoint is given, too.
    #[arg(long = "ignore-witness", value_name = "NAME")]
    ignored: Vec<String>,
}

impl WitnessCheckOptions {
    /// Checks what the operator states against a ledger of so many entries, and the policy in force.
    pub fn check(&self, held: u64, policy: &WitnessPolicy) -> Result<()> {
        if let Some(size) = self.newest_checkpoint.filter(|size| *size != held) {
            bail!(
                "--newest-checkpoint states {}, but the ledger has {}: if the ledger has more, leave the option out; if it has fewer, it is an older copy: restore the newest one",
                counted(size, "entry", "entries"),
                counted(held, "entry", "entries")
            );
        }
        match self.ignored.first() {
            Some(name) if !policy.wants_witnesses() => bail!(
                "--ignore-witness {name}: this log has no witness policy: leave the option out"
            ),
            _ => Ok(()),
        }
    }

    /// These witnesses, without those to be ignored.
    pub fn compared(&self, witnesses: Witnesses) -> Result<Witnesses, CosigningError> {
        witnesses.ignoring(&self.ignored, self.newest_checkpoint.is_some())
    }

    /// Waits until a witness confirms that the log continues what it has cosigned, before anything is signed. If the operator knows that the
    /// ledger is the newest one, it asks once.
    ///
    /// # Errors
    /// A witness has cosigned more entries, or others.
    pub async fn not_behind(
        &self,
        witnesses: &Arc<Witnesses>,
        checkpoint: Vec<u8>,
        prove: ConsistencyProver,
    ) -> Result<()> {
        let mut told = false;
        loop {
            let (witnesses, checkpoint) = (witnesses.clone(), checkpoint.clone());
            let prove = prove.clone();
            match spawn_blocking(move || witnesses.continues(&checkpoint, &prove)).await? {
                Ok(0) if self.newest_checkpoint.is_some() => {
                    tracing::warn!(
                        "no witness answers: votes count, and nothing is published before enough witnesses cosign"
                    );
                    return Ok(());
                }
                Ok(0) if told => {}
                Ok(0) => {
                    tracing::warn!(
                        "no witness answers, so nobody knows whether this ledger is the newest one: nothing is signed before one answers"
                    );
                    told = true;
                }
                Ok(_) => return Ok(()),
                Err(error) => return Err(error).context(OtherHistory::of_witness()),
            }
            sleep(APART).await;
        }
    }
}

/// Ready when a witness contradicts that has not cosigned since the start. A checkpoint of more than the `size` entries of the start ends the
/// watch once a quorum has cosigned it: no other history can get a quorum then, so one witness alone must not end the network.
pub async fn contradiction(
    watched: Option<Arc<Witnesses>>,
    service: Service,
    size: u64,
) -> anyhow::Error {
    let Some(witnesses) = watched else {
        return future::pending().await;
    };
    let contradicted = async {
        loop {
            if let Some((name, why)) = witnesses.contradiction() {
                return anyhow!("witness {name} {why}").context(OtherHistory::of_witness());
            }
            sleep(APART).await;
        }
    };
    tokio::select! {
        biased;
        () = service.cosigned_beyond(size) => future::pending().await,
        error = contradicted => error,
    }
}
