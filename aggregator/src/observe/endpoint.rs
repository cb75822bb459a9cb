//! `/metrics` and `/health`, for the operator.

use crate::observe::troubles::stops_network;
use crate::serve::service::Service;
use futures_core::future::BoxFuture;
use tokio::task::spawn_blocking;
use zk0_service::metrics::endpoint::Observed;

impl Observed for Service {
    fn metrics_text(&self) -> BoxFuture<'_, Result<String, String>> {
        Box::pin(sampled(self))
    }

    fn what_is_wrong(&self) -> Vec<String> {
        let all = self.troubles().all().into_iter();
        let stops = all.filter(|trouble| stops_network(trouble.kind()));
        stops.map(|trouble| trouble.sentence).collect()
    }
}

async fn sampled(service: &Service) -> Result<String, String> {
    let status = service.status().await.map_err(|error| error.to_string())?;
    let (dir, blobs) = service.folder().clone();
    let metrics = service.metrics();
    metrics.sampled.take(&status, &dir);
    let ends_s = service
        .certificate
        .as_ref()
        .map_or(0, |shown| shown.ends_s());
    metrics.certificate_ends.set(ends_s);
    if let Some(witnesses) = service.witnesses() {
        metrics.cosignatures.take(&witnesses.states());
    }
    let sampled = metrics.blobs.clone();
    let taken = spawn_blocking(move || sampled.take(&blobs)).await;
    taken.map_err(|error| error.to_string())?;
    metrics.text().map_err(|error| error.to_string())
}
