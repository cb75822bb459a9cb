//! Whether the aggregator answers, for load balancers and monitors: `proto/health.proto`. An aggregator that cannot go on ends, so that one
//! which answers is in order.

use std::pin::Pin;
use std::time::Duration;
use tokio::sync::watch;
use tokio::time::timeout;
use tokio_stream::{once, Stream, StreamExt};
use tonic::{Request, Response, Status};
use zk0_protocol::rpc::federation::federation_server::SERVICE_NAME;
use zk0_protocol::rpc::health::health_check_response::ServingStatus;
use zk0_protocol::rpc::health::health_server::Health;
use zk0_protocol::rpc::health::{HealthCheckRequest, HealthCheckResponse};

/// Answers that the server and its one service are in order.
pub(super) struct HealthyService {
    /// Whether the service ends.
    pub ending: watch::Receiver<bool>,
    /// How long a monitor watches before it has to ask again.
    pub longest: Duration,
}

impl HealthyService {
    fn status(service: &str) -> ServingStatus {
        match service {
            "" | SERVICE_NAME => ServingStatus::Serving,
            _ => ServingStatus::ServiceUnknown,
        }
    }
}

#[tonic::async_trait]
impl Health for HealthyService {
    async fn check(
        &self,
        request: Request<HealthCheckRequest>,
    ) -> Result<Response<HealthCheckResponse>, Status> {
        let service = request.into_inner().service;
        match Self::status(&service) {
            ServingStatus::Serving => Ok(Response::new(answer(ServingStatus::Serving))),
            _ => Err(Status::not_found("there is no such service")),
        }
    }

    type WatchStream =
        Pin<Box<dyn Stream<Item = Result<HealthCheckResponse, Status>> + Send + 'static>>;

    async fn watch(
        &self,
        request: Request<HealthCheckRequest>,
    ) -> Result<Response<Self::WatchStream>, Status> {
        let status = Self::status(&request.into_inner().service);
        // It changes only when the service ends, and so does the stream.
        let first = once(Ok::<_, Status>(answer(status)));
        let (ending, longest) = (self.ending.clone(), self.longest);
        let end = once(()).then(move |()| ended(ending.clone(), longest));
        let nothing = end.filter_map(|()| None);
        Ok(Response::new(Box::pin(first.chain(nothing))))
    }
}

/// Ready when the service ends, and after `longest` at the latest.
async fn ended(mut ending: watch::Receiver<bool>, longest: Duration) {
    let _ = timeout(longest, ending.wait_for(|ending| *ending)).await;
}

fn answer(status: ServingStatus) -> HealthCheckResponse {
    HealthCheckResponse {
        status: status.into(),
    }
}
