//! Puts the commitment to a recording on the ledger: when the node starts, and again under a fresh secret before the present one is worn
//! out.
//!
//! A node registers again while it has committed in the open round. Its claim there stays about the old dataset, and the next round is
//! about the new one, so no round is lost. A node that was killed goes on: a fresh secret is on disk before the ledger has its commitment,
//! each start registers the newest secret, and what began under the one before ends under it.

use crate::client::NodeClient;
use crate::error::ParticipantError;
use crate::receipts;
use crate::recording::evaluation_set::{EvaluationSet, EvaluationSetSpec};
use crate::recording::secret::{of_another, RegistrationSecret, Secrets};
use crate::recording::OpenRecording;
use crate::state_files::{self, broken};
use crate::turn::unfinished;
use std::path::Path;
use zk0_argument::claim::most_uses;
use zk0_circuits::EvalSpec;
use zk0_protocol::entries::entry::MAX_ENTRY_BYTES;
use zk0_protocol::entries::signed::DatasetRegistration;
use zk0_smolvla::frames::batch::SampleSource;
use zk0_smolvla::frames::sample::PreparedSample;

/// The file of the last registration.
const REGISTRATION: &str = "registration";

/// Whether the node with this state folder has registered a recording.
pub fn has_registered(state: &Path) -> bool {
    state.join(REGISTRATION).exists()
}

/// What a node registers, and where it keeps it.
pub struct Registering<'a> {
    /// The node's state folder.
    pub state: &'a Path,
    /// The recording.
    pub recording: &'a OpenRecording<'a>,
    /// All its frames.
    pub samples: &'a dyn SampleSource<PreparedSample>,
    /// How the network evaluates.
    pub spec: &'a EvalSpec,
}

impl Registering<'_> {
    /// The evaluation set under the newest secret, which is on the ledger when this returns.
    ///
    /// # Errors
    /// The secret of a registered recording is lost; or the recording, the aggregator or the file system fails.
    pub async fn enter(&self, node: &mut NodeClient) -> Result<EvaluationSet, ParticipantError> {
        let secret = self.secret(node)?;
        let set = self.set(node, secret).await?;
        self.register(node, &set).await?;
        Ok(set)
    }

    /// Registers the recording again, under a fresh secret, if that of `present` is worn. The open round still uses `present`.
    ///
    /// # Errors
    /// Those of [`Self::enter`].
    pub async fn again(
        &self,
        node: &mut NodeClient,
        present: &EvaluationSet,
    ) -> Result<(), ParticipantError> {
        let secrets = Secrets::of_registered(self.state)?;
        let last = self.registered(node)?;
        let done = last.is_some_and(|last| !present.secret().is_of(&last.dataset));
        if done || !secrets.is_worn(present.secret(), most_uses(self.spec)) {
            return Ok(());
        }
        // It exists already if registering it failed before.
        let secret = match secrets.newest() {
            Some(newest) if newest != present.secret() => newest.clone(),
            _ => self.fresh(secrets)?,
        };
        tracing::info!(
            "many arguments have opened a sample, so the node registers its recording again, under a fresh secret"
        );
        let set = self.set(node, secret).await?;
        self.register(node, &set).await
    }

    /// The evaluation set for `round`, if it is not `present`: the one with which the node has begun the round, or else the last registered
    /// one.
    ///
    /// # Errors
    /// Those of [`Self::enter`].
    pub async fn of_round(
        &self,
        node: &mut NodeClient,
        round: u64,
        present: &EvaluationSet,
    ) -> Result<Option<EvaluationSet>, ParticipantError> {
        let secrets = Secrets::of_registered(self.state)?;
        let Some(before) = secrets.before() else {
            return Ok(None);
        };
        if let Some(root) = unfinished::begun(self.state, node.network(), round)? {
            if root == present.commitment.root {
                return Ok(None);
            }
            let set = self.set(node, before.clone()).await?;
            if root == set.commitment.root {
                return Ok(Some(set));
            }
        }
        let registered = self.registered(node)?;
        let last = registered.and_then(|registered| secrets.of(&registered.dataset));
        match last.filter(|last| *last != present.secret()) {
            Some(last) => Ok(Some(self.set(node, last.clone()).await?)),
            None => Ok(None),
        }
    }

    /// The newest secret: a fresh one before the first registration.
    fn secret(&self, node: &NodeClient) -> Result<RegistrationSecret, ParticipantError> {
        if let Some(registered) = self.registered(node)? {
            let secrets = Secrets::of_registered(self.state)?;
            let newest = secrets.of(&registered.dataset).and(secrets.newest());
            return newest.cloned().ok_or_else(|| of_another(self.state));
        }
        let secrets = Secrets::read(self.state)?.unwrap_or_default();
        let kept = self.kept()?;
        let of_kept = kept.and_then(|kept| secrets.of(&kept.dataset));
        // An interrupted node goes on with its samples.
        let newest = secrets
            .newest()
            .filter(|newest| secrets.is_unused(newest) && of_kept != Some(newest));
        match newest {
            Some(newest) => Ok(newest.clone()),
            None => self.fresh(secrets),
        }
    }

    /// It is on disk when this returns.
    fn fresh(&self, mut secrets: Secrets) -> Result<RegistrationSecret, ParticipantError> {
        let fresh = RegistrationSecret::fresh()?;
        secrets.add(fresh.clone());
        secrets.keep(self.state)?;
        Ok(fresh)
    }

    async fn set(
        &self,
        node: &mut NodeClient,
        secret: RegistrationSecret,
    ) -> Result<EvaluationSet, ParticipantError> {
        let registered = self.registered(node)?;
        let own = registered.filter(|own| own.node == node.id() && secret.is_of(&own.dataset));
        let by = EvaluationSetSpec {
            network: *node.network(),
            mode: node.genesis().mode,
            // A registration keeps its number. A new one follows the rules in force.
            frames: match own {
                Some(own) => own.evaluation_frames,
                None => node.governance().await?.rules.evaluation_frames,
            },
            secret,
        };
        let name = format!("evaluation-set-{}-{}", by.mode, self.spec.digest());
        let folder = self.state.join(name);
        let set = EvaluationSet::prepare(self.recording, self.samples, self.spec, by, &folder)?;
        self.samples.rest();
        Ok(set)
    }

    /// A node that was restarted gets a receipt of the same entry.
    async fn register(
        &self,
        node: &mut NodeClient,
        set: &EvaluationSet,
    ) -> Result<(), ParticipantError> {
        let (registration, list) = set.registration(node.id());
        let receipt = node.register(registration.clone(), list).await?;
        receipts::keep(self.state, node.genesis(), receipt)?;
        let kept = borsh::to_vec(&registration).expect("writing to a Vec cannot fail");
        state_files::write(&self.state.join(REGISTRATION), &kept)?;
        tracing::info!(
            "committed to {} samples of {} frames, root {}",
            set.commitment.samples,
            self.recording.len(),
            set.commitment.root
        );
        Ok(())
    }

    /// The last registration of this recording in this network, perhaps under another key.
    fn registered(
        &self,
        node: &NodeClient,
    ) -> Result<Option<DatasetRegistration>, ParticipantError> {
        let episodes = self.recording.episodes();
        let kept = self.kept()?;
        Ok(kept.filter(|kept| kept.network == *node.network() && kept.episodes == episodes))
    }

    fn kept(&self) -> Result<Option<DatasetRegistration>, ParticipantError> {
        let path = self.state.join(REGISTRATION);
        let bytes = state_files::read(&path, MAX_ENTRY_BYTES as u64)?;
        let kept = bytes.map(|bytes| borsh::from_slice(&bytes));
        kept.transpose()
            .map_err(|error| broken(&path, error.to_string()))
    }
}
