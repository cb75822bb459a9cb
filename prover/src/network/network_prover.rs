//! Asks the network for proofs, and verifies what it gets. Never run against Succinct's network or a cluster yet: tests play the network on
//! this machine.

use super::account::{AccountError, ProverAccount};
use super::bid::Bid;
use super::options::{NetworkOptions, ProverSelection};
use crate::program::{elf, stdin, ExecuteError, Execution, Executor, Shareable};
use crate::prove::{check_program, verified, OtherProgram, Proof};
use sp1_sdk::network::proto::types::{ExecutionStatus, FulfillmentStatus, ProofMode};
use sp1_sdk::network::signer::NetworkSigner;
use sp1_sdk::network::{
    get_default_rpc_url_for_mode, FulfillmentStrategy, NetworkClient, NetworkMode, B256,
};
use sp1_sdk::{ProofFromNetwork, ProvingKey, SP1ProvingKey, SP1Stdin, SP1_CIRCUIT_VERSION};
use std::fmt::Display;
use std::future::{self, Future};
use std::time::Duration;
use tokio::net::TcpStream;
use tokio::time::{sleep, timeout};
use tonic::transport::Uri;
use zk0_circuits::Mode;

/// Time between two questions how far a proof is. SP1's own client waits as long.
const POLL: Duration = Duration::from_secs(2);
/// How long the network has to answer a first connection.
const CONNECT: Duration = Duration::from_secs(10);
/// How long the end of a request that nobody waits for may take.
const PATIENCE: Duration = Duration::from_secs(10);

/// Why there is no proof.
#[derive(Debug, thiserror::Error)]
pub enum NetworkError {
    /// The key is none, although it has the right length.
    #[error(transparent)]
    Account(#[from] AccountError),
    /// Nobody answers.
    #[error("cannot reach the prover network at {address}: {reason}")]
    Unreachable {
        /// Where.
        address: String,
        /// Why.
        reason: String,
    },
    /// SP1 failed on this machine.
    #[error(transparent)]
    Sp1(#[from] ExecuteError),
    /// The ELF is not the program that verifiers expect.
    #[error(transparent)]
    OtherProgram(#[from] OtherProgram),
    /// The network refuses, or answers what makes no sense.
    #[error("the prover network could not {doing}: {reason}")]
    Refused {
        /// What it was asked for.
        doing: &'static str,
        /// What it said.
        reason: String,
    },
    /// The network has ended the request.
    #[error("the prover network ended the request {request} without a proof: {how}")]
    Ended {
        /// The request's number there.
        request: B256,
        /// How.
        how: &'static str,
    },
    /// It took too long.
    #[error(
        "the prover network made no proof within {0} s: look for the reason there, or give it more time (--network-minutes)"
    )]
    TimedOut(u64),
    /// Nobody waits for the proof any more.
    #[error("the request to the prover network was given up: {0}")]
    GivenUp(String),
    /// The network sent something else than a proof of the program.
    #[error("the prover network sent a proof that does not verify: {0}")]
    Unsound(String),
}

/// An account on a network that knows the program.
pub struct NetworkProver {
    client: NetworkClient,
    options: NetworkOptions,
    mode: Mode,
    program: B256,
}

impl NetworkProver {
    /// Connects to the network and registers the program of a mode there. The program is public.
    pub async fn start(
        account: &ProverAccount,
        options: NetworkOptions,
        executor: &Executor,
        mode: Mode,
    ) -> Result<Self, NetworkError> {
        let signer = NetworkSigner::local(account.key())
            .map_err(|error| AccountError::NotAKey(error.to_string()))?;
        let network = match options.strategy {
            ProverSelection::Auction => NetworkMode::Mainnet,
            ProverSelection::Reserved | ProverSelection::Hosted => NetworkMode::Reserved,
        };
        let address = match account.address() {
            Some(address) => address.to_owned(),
            None => get_default_rpc_url_for_mode(network),
        };
        reach(&address).await?;
        let program = executor.set_up(elf(mode)).await?;
        check_program(&program, mode)?;
        let client = NetworkClient::new(signer, address, network);
        let program = register(&client, &program, options.timeout).await?;
        Ok(Self {
            client,
            options,
            mode,
            program,
        })
    }

    /// Has a claim proven, and verifies the proof as a verifier would. `cost` is what the program took when it was executed. When
    /// `given_up` is ready, or after the time-out, the request is withdrawn where the network allows that. `taken` hears whether a
    /// prover is at work.
    pub async fn prove(
        &self,
        input: Shareable<'_>,
        cost: &Execution,
        given_up: impl Future<Output = impl Display>,
        taken: impl Fn(bool),
    ) -> Result<Proof, NetworkError> {
        let stdin = stdin(&input.input().buffers);
        let end = async {
            tokio::select! {
                reason = given_up => NetworkError::GivenUp(reason.to_string()),
                () = sleep(self.options.timeout) => NetworkError::TimedOut(self.options.timeout.as_secs()),
            }
        };
        let request = self.request(&stdin, cost);
        tokio::pin!(end, request);
        taken(false);
        // A request that nobody waits for must not begin.
        tokio::select! {
            biased;
            error = &mut end => return Err(error),
            () = future::ready(()) => {}
        }
        let id = tokio::select! {
            id = &mut request => id?,
            error = &mut end => {
                // The network may have taken the request already. Without its number nobody could withdraw it.
                if let Ok(Ok(id)) = timeout(PATIENCE, request).await {
                    self.withdraw(id).await;
                }
                return Err(error);
            }
        };
        tracing::info!(request = %id, "the prover network has the request");
        let waited = tokio::select! {
            proof = self.wait(id, &taken) => proof,
            error = &mut end => Err(error),
        };
        if let Err(
            NetworkError::GivenUp(_) | NetworkError::TimedOut(_) | NetworkError::Refused { .. },
        ) = waited
        {
            self.withdraw(id).await;
        }
        let proof = waited?;
        verified(self.mode, &proof.proof, proof.public_values.to_vec())
            .map_err(NetworkError::Unsound)
    }

    /// Uploads the private input and asks for a proof. Returns the request's number.
    async fn request(&self, stdin: &SP1Stdin, cost: &Execution) -> Result<B256, NetworkError> {
        let doing = "take the request";
        let ProverSelection::Auction = self.options.strategy else {
            return self.request_for(stdin, cost, Bid::default()).await;
        };
        let params = self
            .client
            .get_proof_request_params(ProofMode::Compressed)
            .await;
        let params = params.map_err(|error| refused(doing, format!("{error:#}")))?;
        let bid = Bid::suggested(params).map_err(|reason| refused(doing, reason))?;
        self.request_for(stdin, cost, bid).await
    }

    async fn request_for(
        &self,
        stdin: &SP1Stdin,
        cost: &Execution,
        bid: Bid,
    ) -> Result<B256, NetworkError> {
        let doing = "take the request";
        // A cluster of one's own is asked as SP1's client asks it: without limits, and with an input that any of its machines may fetch.
        let (strategy, cycle_limit, gas_limit, private) = match self.options.strategy {
            ProverSelection::Auction => (FulfillmentStrategy::Auction, cost.cycles, cost.gas, true),
            ProverSelection::Reserved => {
                (FulfillmentStrategy::Reserved, cost.cycles, cost.gas, true)
            }
            ProverSelection::Hosted => (FulfillmentStrategy::Hosted, u64::MAX, u64::MAX, false),
        };
        let response = self
            .client
            .request_proof(
                self.program,
                stdin,
                ProofMode::Compressed,
                SP1_CIRCUIT_VERSION,
                strategy,
                self.options.timeout.as_secs(),
                cycle_limit,
                gas_limit,
                0,
                None,
                bid.auctioneer,
                bid.executor,
                bid.verifier,
                bid.treasury,
                None,
                bid.base_fee,
                bid.max_price,
                bid.domain,
                private,
            )
            .await
            .map_err(|error| refused(doing, format!("{error:#}")))?;
        let id = response.request_id();
        B256::try_from(id).map_err(|_| {
            let count = id.len();
            refused(
                doing,
                format!("it gave it a number of {count} bytes, and 32 are needed"),
            )
        })
    }

    /// Waits for the proof.
    async fn wait(
        &self,
        request: B256,
        taken: &impl Fn(bool),
    ) -> Result<ProofFromNetwork, NetworkError> {
        let ended = |how| Err(NetworkError::Ended { request, how });
        loop {
            // SP1's client asks again while the network is away. By default it gives up after two minutes, and another proof would cost as much again.
            let (status, proof) = self
                .client
                .get_proof_request_status(request, Some(self.options.timeout))
                .await
                .map_err(|error| refused("send the proof", format!("{error:#}")))?;
            if let Some(proof) = proof {
                return Ok(proof);
            }
            if status.execution_status() == ExecutionStatus::Unexecutable as i32 {
                return ended("it cannot execute the program on this input");
            }
            // The client refuses numbers that are not in the protocol.
            match FulfillmentStatus::try_from(status.fulfillment_status()) {
                Ok(FulfillmentStatus::Unfulfillable) => return ended("it cannot be fulfilled"),
                Ok(FulfillmentStatus::Reverted) => return ended("it failed in settlement"),
                Ok(FulfillmentStatus::Expired) => return ended("its time is over"),
                status => taken(status == Ok(FulfillmentStatus::Assigned)),
            }
            sleep(POLL).await;
        }
    }

    /// Withdraws a request, so that nobody works on it and nobody pays for it. Only auctions know that.
    async fn withdraw(&self, request: B256) {
        if self.options.strategy != ProverSelection::Auction {
            tracing::warn!(%request, "nobody waits for this proof; the network may go on with it until its deadline, because only auctions let requests be withdrawn");
            return;
        }
        match timeout(PATIENCE, self.client.cancel_request(request)).await {
            Ok(Ok(_)) => tracing::info!(%request, "the request was withdrawn"),
            Ok(Err(error)) => {
                tracing::warn!(%request, "the request could not be withdrawn: {error:#}")
            }
            Err(_) => {
                tracing::warn!(%request, "the request could not be withdrawn: the network does not answer")
            }
        }
    }
}

/// Whether somebody listens there. SP1's client would try for two minutes, and would not say why it fails.
async fn reach(address: &str) -> Result<(), NetworkError> {
    let unreachable = |reason: String| NetworkError::Unreachable {
        address: address.to_owned(),
        reason,
    };
    let uri: Uri = address
        .parse()
        .map_err(|error| unreachable(format!("{error}")))?;
    let host = uri.host().unwrap_or_default().trim_matches(['[', ']']);
    let port = uri.port_u16().unwrap_or(match uri.scheme_str() {
        Some("http") => 80,
        _ => 443,
    });
    match timeout(CONNECT, TcpStream::connect((host, port))).await {
        Ok(Ok(_)) => Ok(()),
        Ok(Err(error)) => Err(unreachable(error.to_string())),
        Err(_) => {
            let seconds = CONNECT.as_secs();
            Err(unreachable(format!("no connection after {seconds} s")))
        }
    }
}

/// Makes sure that the network has the program. Returns the program's name there.
async fn register(
    client: &NetworkClient,
    program: &SP1ProvingKey,
    patience: Duration,
) -> Result<B256, NetworkError> {
    let doing = "register the guest program";
    let registered = client.register_program(program.verifying_key(), program.elf());
    match timeout(patience, registered).await {
        Ok(name) => name.map_err(|error| refused(doing, format!("{error:#}"))),
        Err(_) => {
            let seconds = patience.as_secs();
            Err(refused(doing, format!("no answer within {seconds} s")))
        }
    }
}

fn refused(doing: &'static str, reason: String) -> NetworkError {
    NetworkError::Refused { doing, reason }
}
