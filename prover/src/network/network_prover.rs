//! Asks the network for proofs, and verifies them. Never run against Succinct's network or a cluster yet: tests play the network.

use super::account::{AccountError, ProverAccount};
use super::bid::Bid;
use super::options::{NetworkOptions, ProverSelection};
use crate::program::{carried, stdin, ExecuteError, Execution, Executor, LacksProgram, Shareable};
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

/// Time between questions about a proof, as in SP1's client.
const POLL: Duration = Duration::from_secs(2);
/// The network's time to answer a first connection.
const CONNECT: Duration = Duration::from_secs(10);
/// Time to end an unwanted request.
const PATIENCE: Duration = Duration::from_secs(10);

/// Why there is no proof.
#[derive(Debug, thiserror::Error)]
pub enum NetworkError {
    /// The key has the right length, but is invalid.
    #[error(transparent)]
    Account(#[from] AccountError),
    /// No answer.
    #[error("cannot reach the prover network at {address}: {reason}")]
    Unreachable {
        /// The address.
        address: String,
        /// The reason.
        reason: String,
    },
    /// SP1 failed on this machine.
    #[error(transparent)]
    Sp1(#[from] ExecuteError),
    /// This release lacks the claim's program.
    #[error(transparent)]
    Lacks(#[from] LacksProgram),
    /// Verifiers do not expect this ELF.
    #[error(transparent)]
    OtherProgram(#[from] OtherProgram),
    /// The network refuses, or gives a senseless answer.
    #[error("the prover network could not {doing}: {reason}")]
    Refused {
        /// The question.
        doing: &'static str,
        /// The answer.
        reason: String,
    },
    /// The network ended the request.
    #[error("the prover network ended the request {request} without a proof: {how}")]
    Ended {
        /// The request's number.
        request: B256,
        /// The end.
        how: &'static str,
    },
    /// The time-out.
    #[error(
        "the prover network made no proof within {0} s: look for the reason there, or give it more time (--network-minutes)"
    )]
    TimedOut(u64),
    /// The client no longer waits.
    #[error("the request to the prover network was given up: {0}")]
    GivenUp(String),
    /// The network sent no proof of the program.
    #[error("the prover network sent a proof that does not verify: {0}")]
    Unsound(String),
}

/// An account on a network that has the programs.
pub struct NetworkProver {
    client: NetworkClient,
    options: NetworkOptions,
    /// The verifying key of each program, and its name there.
    programs: Vec<(&'static [u8; 32], B256)>,
}

impl NetworkProver {
    /// Connects to the network and registers a mode's public programs.
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
        let client = NetworkClient::new(signer, address, network);
        let mut programs = Vec::new();
        for (key, elf) in carried(mode) {
            let program = executor.set_up(elf).await?;
            check_program(&program, key)?;
            programs.push((key, register(&client, &program, options.timeout).await?));
        }
        Ok(Self {
            client,
            options,
            programs,
        })
    }

    /// Has a claim proven, and verifies the proof as a verifier would. `cost` is the program's execution. When `given_up` is ready, or
    /// after the time-out, the request is withdrawn where possible. `taken` hears whether a prover works on it.
    pub async fn prove(
        &self,
        input: Shareable<'_>,
        cost: &Execution,
        given_up: impl Future<Output = impl Display>,
        taken: impl Fn(bool),
    ) -> Result<Proof, NetworkError> {
        let input = input.input();
        let found = self
            .programs
            .iter()
            .find(|(key, _)| key[..] == input.program[..]);
        let (key, program) = found.ok_or_else(|| LacksProgram(input.program.clone()))?;
        let stdin = stdin(&input.buffers);
        let end = async {
            tokio::select! {
                reason = given_up => NetworkError::GivenUp(reason.to_string()),
                () = sleep(self.options.timeout) => NetworkError::TimedOut(self.options.timeout.as_secs()),
            }
        };
        let request = self.request(*program, &stdin, cost);
        tokio::pin!(end, request);
        taken(false);
        // An unwanted request must not begin.
        tokio::select! {
            biased;
            error = &mut end => return Err(error),
            () = future::ready(()) => {}
        }
        let id = tokio::select! {
            id = &mut request => id?,
            error = &mut end => {
                // The network may have the request already. Withdrawal needs its number.
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
        verified(key, &proof.proof, proof.public_values.to_vec()).map_err(NetworkError::Unsound)
    }

    /// Uploads the private input; returns the request's number.
    async fn request(
        &self,
        program: B256,
        stdin: &SP1Stdin,
        cost: &Execution,
    ) -> Result<B256, NetworkError> {
        let doing = "take the request";
        let ProverSelection::Auction = self.options.strategy else {
            return self.request_for(program, stdin, cost, Bid::default()).await;
        };
        let params = self
            .client
            .get_proof_request_params(ProofMode::Compressed)
            .await;
        let params = params.map_err(|error| refused(doing, format!("{error:#}")))?;
        let bid = Bid::suggested(params).map_err(|reason| refused(doing, reason))?;
        self.request_for(program, stdin, cost, bid).await
    }

    async fn request_for(
        &self,
        program: B256,
        stdin: &SP1Stdin,
        cost: &Execution,
        bid: Bid,
    ) -> Result<B256, NetworkError> {
        let doing = "take the request";
        // As in SP1's client, a private cluster gets no limits, and an input that any of its machines may fetch.
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
                program,
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

    async fn wait(
        &self,
        request: B256,
        taken: &impl Fn(bool),
    ) -> Result<ProofFromNetwork, NetworkError> {
        let ended = |how| Err(NetworkError::Ended { request, how });
        loop {
            // While the network is away, SP1's client retries, by default for two minutes only. A new proof would cost as much again.
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
            // The client refuses numbers outside the protocol.
            match FulfillmentStatus::try_from(status.fulfillment_status()) {
                Ok(FulfillmentStatus::Unfulfillable) => return ended("it cannot be fulfilled"),
                Ok(FulfillmentStatus::Reverted) => return ended("it failed in settlement"),
                Ok(FulfillmentStatus::Expired) => return ended("its time is over"),
                status => taken(status == Ok(FulfillmentStatus::Assigned)),
            }
            sleep(POLL).await;
        }
    }

    /// Withdraws a request, so that no prover works on it and no account pays. Only auctions allow that.
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

/// SP1's client would try for two minutes, without a reason.
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

/// Registers the program, unless the network has it. Returns its name there.
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
