//! Whether the aggregator is in order: `proto/health.proto`. An aggregator that cannot go on ends; one that goes on may have trouble
//! ([`crate::observe::troubles`]). Monitors ask about the whole server, load balancers about its service by name.

use crate::observe::troubles::{stops_network, stops_requests, Trouble, Troubles};
use std::collections::BTreeMap;
use std::time::Duration;
use tokio::sync::{mpsc, watch};
use tokio::time::timeout;
use tokio_stream::wrappers::ReceiverStream;
use tonic::{Request, Response, Status};
use zk0_protocol::rpc::federation::federation_server::SERVICE_NAME;
use zk0_protocol::rpc::federation::trouble::Kind;
use zk0_protocol::rpc::health::health_check_response::ServingStatus;
use zk0_protocol::rpc::health::health_server::Health;
use zk0_protocol::rpc::health::{HealthCheckRequest, HealthCheckResponse};

pub(super) struct HealthyService {
    pub troubles: Troubles,
    /// Whether the service ends.
    pub ending: watch::Receiver<bool>,
    /// How long a monitor watches.
    pub longest: Duration,
}

fn status(service: &str, in_force: &BTreeMap<Kind, Trouble>) -> ServingStatus {
    let stops = match service {
        "" => stops_network,
        SERVICE_NAME => stops_requests,
        _ => return ServingStatus::ServiceUnknown,
    };
    if in_force.keys().any(|kind| stops(*kind)) {
        ServingStatus::NotServing
    } else {
        ServingStatus::Serving
    }
}

#[tonic::async_trait]
impl Health for HealthyService {
    async fn check(
        &self,
        request: Request<HealthCheckRequest>,
    ) -> Result<Response<HealthCheckResponse>, Status> {
        let service = request.into_inner().service;
        match status(&service, &self.troubles.follow().borrow()) {
            ServingStatus::ServiceUnknown => Err(Status::not_found("there is no such service")),
            status => Ok(Response::new(answer(status))),
        }
    }

    type WatchStream = ReceiverStream<Result<HealthCheckResponse, Status>>;

    async fn watch(
        &self,
        request: Request<HealthCheckRequest>,
    ) -> Result<Response<Self::WatchStream>, Status> {
        let service = request.into_inner().service;
        let (sender, told) = mpsc::channel(1);
        let (troubles, longest) = (self.troubles.follow(), self.longest);
        let ending = self.ending.clone();
        tokio::spawn(async move {
            tokio::select! {
                () = tell(&service, troubles, &sender) => {}
                () = ended(ending, longest) => {}
                () = sender.closed() => {}
            }
        });
        Ok(Response::new(ReceiverStream::new(told)))
    }
}

async fn tell(
    service: &str,
    mut troubles: watch::Receiver<BTreeMap<Kind, Trouble>>,
    sender: &mpsc::Sender<Result<HealthCheckResponse, Status>>,
) {
    let mut told = None;
    loop {
        let now = status(service, &troubles.borrow_and_update());
        if told.replace(now) != Some(now) && sender.send(Ok(answer(now))).await.is_err() {
            return;
        }
        if troubles.changed().await.is_err() {
            return;
        }
    }
}

/// Ready when the service ends, or after `longest`.
async fn ended(mut ending: watch::Receiver<bool>, longest: Duration) {
    let _ = timeout(longest, ending.wait_for(|ending| *ending)).await;
}

fn answer(status: ServingStatus) -> HealthCheckResponse {
    HealthCheckResponse {
        status: status.into(),
    }
}
