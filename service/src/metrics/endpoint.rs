//! `GET /metrics` for Prometheus and `GET /health` for monitors, on a listener for the operator alone.

use crate::metrics::registry::MetricRegistry;
use crate::metrics::troubles::ServiceTroubles;
use axum::extract::State;
use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use axum::Router;
use futures_core::future::BoxFuture;
use std::future;
use std::sync::Arc;

const OPENMETRICS: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";

const TEXT: &str = "text/plain; charset=utf-8";

/// A service that its operator observes.
pub trait Observed: Send + Sync + 'static {
    /// All metrics as text.
    ///
    /// # Errors
    /// A sentence: why there are none.
    fn metrics_text(&self) -> BoxFuture<'_, Result<String, String>>;

    /// A sentence for each thing that is wrong.
    fn what_is_wrong(&self) -> Vec<String>;
}

/// What a service shows that updates its metrics itself.
#[derive(Clone)]
pub struct ObservedService {
    /// Its metrics.
    pub registry: Arc<MetricRegistry>,
    /// What is wrong with it.
    pub troubles: ServiceTroubles,
}

impl Observed for ObservedService {
    fn metrics_text(&self) -> BoxFuture<'_, Result<String, String>> {
        let text = self.registry.text();
        Box::pin(future::ready(text.map_err(|error| error.to_string())))
    }

    fn what_is_wrong(&self) -> Vec<String> {
        self.troubles.sentences()
    }
}

/// The routes to what a service shows.
pub fn router(service: impl Observed) -> Router {
    let service: Arc<dyn Observed> = Arc::new(service);
    Router::new()
        .route("/metrics", get(metrics))
        .route("/health", get(health))
        .with_state(service)
}

async fn metrics(State(service): State<Arc<dyn Observed>>) -> Response {
    match service.metrics_text().await {
        Ok(text) => answer(StatusCode::OK, OPENMETRICS, text),
        Err(why) => answer(StatusCode::SERVICE_UNAVAILABLE, TEXT, format!("{why}\n")),
    }
}

async fn health(State(service): State<Arc<dyn Observed>>) -> Response {
    let wrong = service.what_is_wrong();
    if wrong.is_empty() {
        answer(StatusCode::OK, TEXT, "the service is in order\n".into())
    } else {
        let lines = wrong.join("\n") + "\n";
        answer(StatusCode::SERVICE_UNAVAILABLE, TEXT, lines)
    }
}

fn answer(status: StatusCode, kind: &'static str, text: String) -> Response {
    let headers = [(CONTENT_TYPE, kind), (CACHE_CONTROL, "no-cache")];
    (status, headers, text).into_response()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_service_in_trouble_is_not_healthy() {
        let mut registry = MetricRegistry::default();
        let troubles = ServiceTroubles::registered(&mut registry, &["peer"]);
        let registry = Arc::new(registry);
        let service: Arc<dyn Observed> = Arc::new(ObservedService {
            registry,
            troubles: troubles.clone(),
        });
        assert_eq!(health(State(service.clone())).await.status(), 200);
        troubles.raise("peer", "the peer is away");
        assert_eq!(health(State(service.clone())).await.status(), 503);
        let shown = metrics(State(service)).await;
        assert_eq!(shown.status(), 200);
        assert_eq!(shown.headers()[CONTENT_TYPE], OPENMETRICS);
    }
}
