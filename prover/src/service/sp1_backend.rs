//! SP1 as the service's backend: on this machine, or on a prover network.

use super::backend::{Backend, JobError};
#[cfg(feature = "network")]
use super::elsewhere::Elsewhere;
use super::here::{Here, HereError};
use super::schedule::Pace;
use super::waiting::{GivenUp, WaitingClient};
use crate::machine::{DeviceError, DeviceKind};
#[cfg(feature = "network")]
use crate::network::ProverAccount;
use crate::network::{AccountError, NetworkOptions};
#[cfg(feature = "network")]
use crate::program::Shareable;
use crate::program::{elf_of, ExecuteError, Execution, Executor, GuestInput};
use crate::prove::Proof;
use zk0_circuits::Claim;

/// Executes with SP1 here, and proves here or elsewhere.
pub struct Sp1Backend {
    executor: Executor,
    place: ProverLocation,
}

enum ProverLocation {
    Here(Here),
    #[cfg(feature = "network")]
    Elsewhere(Elsewhere),
}

/// Why there can be no proofs.
#[derive(Debug, thiserror::Error)]
pub enum Sp1BackendError {
    /// This machine cannot prove.
    #[error(transparent)]
    Here(#[from] HereError),
    /// This build cannot ask a network.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// The network has no account.
    #[error(transparent)]
    Account(#[from] AccountError),
    /// SP1's executor did not start.
    #[error(transparent)]
    Executor(#[from] ExecuteError),
}

impl Sp1Backend {
    /// Finds this machine's device, or reads the network's account from the environment. SP1, or the connection, starts with the service.
    pub async fn new(device: DeviceKind, network: NetworkOptions) -> Result<Self, Sp1BackendError> {
        let place = match device {
            DeviceKind::Network => elsewhere(network)?,
            device => ProverLocation::Here(Here::find(device)?),
        };
        Self::at(place).await
    }

    /// The backend of an account on a network.
    #[cfg(feature = "network")]
    pub async fn of_account(
        account: ProverAccount,
        options: NetworkOptions,
    ) -> Result<Self, Sp1BackendError> {
        Self::at(ProverLocation::Elsewhere(Elsewhere::new(account, options))).await
    }

    async fn at(place: ProverLocation) -> Result<Self, Sp1BackendError> {
        let executor = Executor::new().await?;
        Ok(Self { executor, place })
    }

    /// The likely pace before the first proof. A GPU counts as a CPU.
    pub fn pace(&self) -> Pace {
        match &self.place {
            ProverLocation::Here(_) => {
                let cores = std::thread::available_parallelism().map_or(1, |cores| cores.get());
                Pace::of_cores(cores)
            }
            #[cfg(feature = "network")]
            ProverLocation::Elsewhere(network) => Pace::AtMost(network.options().timeout),
        }
    }
}

#[cfg(feature = "network")]
fn elsewhere(options: NetworkOptions) -> Result<ProverLocation, Sp1BackendError> {
    let account = ProverAccount::from_environment()?;
    Ok(ProverLocation::Elsewhere(Elsewhere::new(account, options)))
}

#[cfg(not(feature = "network"))]
fn elsewhere(_: NetworkOptions) -> Result<ProverLocation, Sp1BackendError> {
    Err(DeviceError::NetworkNotBuilt.into())
}

#[tonic::async_trait]
impl Backend for Sp1Backend {
    async fn start(&self) -> Result<(), JobError> {
        match &self.place {
            ProverLocation::Here(here) => here.prover().await.map(|_| ()),
            #[cfg(feature = "network")]
            ProverLocation::Elsewhere(network) => network.prover(&self.executor).await.map(|_| ()),
        }
    }

    async fn check(&self, input: &GuestInput) -> Result<Execution, JobError> {
        // If the input may not go to the network, the client hears so first.
        #[cfg(feature = "network")]
        if let ProverLocation::Elsewhere(_) = self.place {
            Shareable::of(input)?;
        }
        // The native check comes first: it is fast, and gives the full reason.
        let claim = input.claim()?;
        let elf = elf_of(input.mode, &input.program).map_err(JobError::failed)?;
        let execution = self
            .executor
            .execute(elf, &input.buffers)
            .await
            .map_err(JobError::failed)?;
        match borsh::from_slice::<Claim>(&execution.public_values) {
            Ok(proven) if proven == claim => Ok(execution),
            _ => Err(JobError::Failed(
                "the guest program commits to another claim than the statement gives here".into(),
            )),
        }
    }

    // A local prover does not need the cost.
    #[cfg_attr(not(feature = "network"), allow(unused_variables))]
    async fn prove(
        &self,
        input: &GuestInput,
        execution: &Execution,
        waiting: &WaitingClient,
    ) -> Result<Proof, JobError> {
        match &self.place {
            ProverLocation::Here(here) => {
                let proven = async {
                    let prover = here.prover().await?;
                    let proven = prover.prove_compressed(input).await;
                    proven.map_err(JobError::failed)
                };
                tokio::select! {
                    proven = proven => proven,
                    // SP1 cannot be interrupted. It runs until the process ends.
                    () = waiting.stopping() => Err(GivenUp::Stopping.into()),
                }
            }
            #[cfg(feature = "network")]
            ProverLocation::Elsewhere(network) => {
                network
                    .prove(&self.executor, input, execution, waiting)
                    .await
            }
        }
    }

    #[cfg(feature = "network")]
    fn withdraws(&self) -> bool {
        matches!(self.place, ProverLocation::Elsewhere(_))
    }
}

#[cfg(all(test, not(feature = "network")))]
mod tests {
    use super::*;
    use crate::network::ProverSelection;
    use std::time::Duration;

    #[tokio::test]
    async fn a_build_without_the_feature_says_how_to_get_one_with_it() {
        let options = NetworkOptions {
            strategy: ProverSelection::Auction,
            timeout: Duration::from_secs(1),
        };
        let error = Sp1Backend::new(DeviceKind::Network, options).await.err();
        let error = error.expect("there is no network").to_string();
        assert!(error.contains("make network"), "{error}");
    }
}
