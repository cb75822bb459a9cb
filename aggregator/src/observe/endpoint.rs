//! `GET /metrics`, for Prometheus and the operator alone, so on a listener of its own.

use crate::publish::http::{answer, text, Router, NO_CACHE};
use crate::serve::service::Service;
use axum::extract::State;
use axum::response::Response;
use axum::routing::get;
use tokio::task::spawn_blocking;

const OPENMETRICS: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";

/// The route to the metrics of this service.
pub fn router(service: Service) -> Router {
    Router::new()
        .route("/metrics", get(metrics))
        .with_state(service)
}

async fn metrics(State(service): State<Service>) -> Response {
    let ledger = service.with(|aggregator| {
        let ledger = aggregator.ledger();
        Ok((ledger.dir().to_owned(), ledger.blobs().clone()))
    });
    let (status, (dir, blobs)) = match (service.status().await, ledger.await) {
        (Ok(status), Ok(ledger)) => (status, ledger),
        (Err(error), _) | (_, Err(error)) => return text(503, format!("{error}\n")),
    };
    let metrics = service.metrics();
    metrics.sampled.take(&status, &dir);
    let ends_s = service
        .certificate
        .as_ref()
        .map_or(0, |shown| shown.ends_s());
    metrics.certificate_ends.set(ends_s);
    if let Some(witnesses) = service.witnesses() {
        metrics.witnesses.take(&witnesses.states());
    }
    let sampled = metrics.blobs.clone();
    if let Err(error) = spawn_blocking(move || sampled.take(&blobs)).await {
        return text(500, format!("{error}\n"));
    }
    match metrics.text() {
        Ok(text) => answer(200, OPENMETRICS, NO_CACHE, text),
        Err(error) => text(500, format!("{error}\n")),
    }
}
