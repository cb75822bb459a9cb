//! The service's proofs from a prover network. They need no memory here, so no lock.

use super::backend::JobError;
use super::waiting::{GivenUp, WaitingClient};
use crate::network::{NetworkError, NetworkOptions, NetworkProver, ProverAccount};
use crate::program::{Execution, Executor, GuestInput, Shareable};
use crate::prove::Proof;
use tokio::sync::OnceCell;
use zk0_circuits::Mode;

/// An account on a network, connected on first use.
pub(super) struct Elsewhere {
    account: ProverAccount,
    options: NetworkOptions,
    prover: OnceCell<NetworkProver>,
}

impl Elsewhere {
    pub fn new(account: ProverAccount, options: NetworkOptions) -> Self {
        Self {
            account,
            options,
            prover: OnceCell::new(),
        }
    }

    pub fn options(&self) -> NetworkOptions {
        self.options
    }

    pub async fn prover(&self, executor: &Executor) -> Result<&NetworkProver, JobError> {
        self.prover
            .get_or_try_init(|| {
                NetworkProver::start(&self.account, self.options, executor, Mode::Succinct)
            })
            .await
            .map_err(JobError::failed)
    }

    /// Has a claim proven, if its input may leave this machine.
    pub async fn prove(
        &self,
        executor: &Executor,
        input: &GuestInput,
        execution: &Execution,
        waiting: &WaitingClient,
    ) -> Result<Proof, JobError> {
        let input = Shareable::of(input)?;
        let prover = self.prover(executor).await?;
        let taken = |taken| waiting.taken(taken);
        prover
            .prove(input, execution, waiting.given_up(), taken)
            .await
            .map_err(|error| match error {
                // A client that has gone hears nothing, so this means a stopping service.
                NetworkError::GivenUp(_) => JobError::GivenUp(GivenUp::Stopping),
                error => JobError::failed(error),
            })
    }
}
