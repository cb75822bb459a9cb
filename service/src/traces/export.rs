//! Sends this process's spans to a collector, by OTLP over gRPC.
//!
//! Nothing waits for the collector. Ended spans wait in a queue of a fixed length, which a thread with its own runtime sends; the rest is
//! lost. The log states once that a collector does not take spans, and once that it takes them again.

use crate::tls::service_address::{ConnectError, ServiceAddress};
use opentelemetry::trace::TracerProvider;
use opentelemetry_otlp::{ExporterBuildError, SpanExporter as Otlp, WithTonicConfig};
use opentelemetry_sdk::error::{OTelSdkError, OTelSdkResult};
use opentelemetry_sdk::trace::{Sampler, SdkTracerProvider, SpanData, SpanExporter};
use opentelemetry_sdk::Resource;
use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::Arc;
use std::time::Duration;
use tokio::runtime::{Builder, Handle, Runtime};
use tokio::time::timeout;
use tracing::{Metadata, Subscriber};
use tracing_subscriber::filter::filter_fn;
use tracing_subscriber::registry::LookupSpan;
use tracing_subscriber::Layer;

/// The time limit for one transfer to a collector.
const PATIENCE: Duration = Duration::from_secs(10);

/// How long the process waits at its end for unsent spans.
const ENDING: Duration = Duration::from_secs(2);

/// Sends this process's spans to a collector. When dropped, it sends the rest for at most two seconds.
pub struct Traces {
    provider: SdkTracerProvider,
    collector: ServiceAddress,
    /// Drives the connection. `None` only while this is dropped.
    runtime: Option<Runtime>,
}

/// Why traces cannot be sent.
#[derive(Debug, thiserror::Error)]
pub enum TracesError {
    /// The collector's address, or its choice of certificates, is wrong.
    #[error(transparent)]
    Address(#[from] ConnectError),
    /// The system gives no thread.
    #[error("no thread sends traces: {0}")]
    Runtime(io::Error),
    /// An environment variable of OpenTelemetry (`OTEL_…`) has a wrong value.
    #[error("traces cannot be sent: {0}")]
    Exporter(#[from] ExporterBuildError),
}

impl Traces {
    /// The address of a collector, such as `http://127.0.0.1:4317`.
    pub fn collector(url: String) -> ServiceAddress {
        ServiceAddress::new("collector", url, "--otlp-ca")
    }

    /// Sends the traces of `service`, such as `zk0-node`, to this collector, which need not run yet.
    pub fn to(collector: ServiceAddress, service: &'static str) -> Result<Self, TracesError> {
        let runtime = Builder::new_multi_thread()
            .worker_threads(1)
            .thread_name("zk0-traces")
            .enable_all()
            .build()
            .map_err(TracesError::Runtime)?;
        let entered = runtime.enter();
        let channel = collector.connect_lazily()?;
        let otlp = Otlp::builder().with_tonic().with_channel(channel).build()?;
        let resource = Resource::builder()
            .with_service_name(service)
            .with_attribute(opentelemetry::KeyValue::new(
                "service.version",
                env!("CARGO_PKG_VERSION"),
            ));
        let provider = SdkTracerProvider::builder()
            // A request's sender must not decide whether a span is recorded.
            .with_sampler(Sampler::AlwaysOn)
            .with_resource(resource.build())
            .with_batch_exporter(Patient {
                otlp: Arc::new(otlp),
                runtime: runtime.handle().clone(),
                url: collector.url().to_owned(),
                failing: AtomicBool::new(false),
            })
            .build();
        drop(entered);
        Ok(Self {
            provider,
            collector,
            runtime: Some(runtime),
        })
    }

    /// A layer for the process's subscriber.
    pub fn layer<S>(&self) -> impl Layer<S> + Send + Sync
    where
        S: Subscriber + for<'a> LookupSpan<'a> + Send + Sync,
    {
        tracing_opentelemetry::layer()
            .with_tracer(self.provider.tracer("zk0"))
            .with_target(false)
            .with_location(false)
            .with_threads(false)
            .with_tracked_inactivity(false)
            .with_filter(filter_fn(is_ours))
    }

    /// Logs where the traces go.
    pub fn announce(&self) {
        tracing::info!("traces are sent to {}", self.collector.url());
        self.collector.warn_if_plain();
    }
}

impl Drop for Traces {
    fn drop(&mut self) {
        // If this fails, the log has the reason.
        let _ = self.provider.shutdown_with_timeout(ENDING);
        if let Some(runtime) = self.runtime.take() {
            runtime.shutdown_background();
        }
    }
}

/// Only zk0's own spans are sent: no log events, and none of the libraries, some of which send spans.
fn is_ours(metadata: &Metadata<'_>) -> bool {
    metadata.is_span()
        && metadata.target().starts_with("zk0")
        && *metadata.level() <= tracing::Level::INFO
}

/// An exporter with a time limit that logs a failure once.
#[derive(Debug)]
struct Patient {
    otlp: Arc<Otlp>,
    runtime: Handle,
    url: String,
    failing: AtomicBool,
}

impl SpanExporter for Patient {
    async fn export(&self, batch: Vec<SpanData>) -> OTelSdkResult {
        let otlp = self.otlp.clone();
        // Timers need a runtime, and the calling thread has none.
        let sent = self.runtime.spawn(async move {
            match timeout(PATIENCE, otlp.export(batch)).await {
                Ok(sent) => sent,
                Err(_) => Err(OTelSdkError::Timeout(PATIENCE)),
            }
        });
        let sent = match sent.await {
            Ok(sent) => sent,
            Err(error) => Err(OTelSdkError::InternalFailure(error.to_string())),
        };
        let (failed, url) = (sent.is_err(), &self.url);
        let failed_before = self.failing.swap(failed, Ordering::AcqRel);
        match &sent {
            Err(why) if !failed_before => tracing::warn!(
                "the collector at {url} takes no traces ({why}); traces are lost until it does"
            ),
            Ok(()) if failed_before => tracing::info!("the collector at {url} takes traces again"),
            _ => {}
        }
        sent
    }

    fn set_resource(&mut self, resource: &Resource) {
        // Nothing is being sent yet, so there is no other owner.
        if let Some(otlp) = Arc::get_mut(&mut self.otlp) {
            otlp.set_resource(resource);
        }
    }
}
