//! `GET /metrics`, for Prometheus. It has a listener of its own, because what it tells is for the operator alone.

use crate::publish::http::{answer, text, Router, NO_CACHE};
use crate::serve::service::Service;
use axum::extract::State;
use axum::response::Response;
use axum::routing::get;

/// The format of the answer.
const OPENMETRICS: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";

/// The route to the metrics of this service.
pub fn router(service: Service) -> Router {
    Router::new()
        .route("/metrics", get(metrics))
        .with_state(service)
}

async fn metrics(State(service): State<Service>) -> Response {
    let dir = service.with(|aggregator| Ok(aggregator.ledger().dir().to_owned()));
    let (status, dir) = match (service.status().await, dir.await) {
        (Ok(status), Ok(dir)) => (status, dir),
        (Err(error), _) | (_, Err(error)) => return text(503, format!("{error}\n")),
    };
    let metrics = service.metrics();
    let connections = metrics.connections.counts();
    metrics.sampled.take(&status, connections, &dir);
    match metrics.text() {
        Ok(text) => answer(200, OPENMETRICS, NO_CACHE, text),
        Err(error) => text(500, format!("{error}\n")),
    }
}
