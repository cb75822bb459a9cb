//! Sends the spans of this process to a collector, by OTLP over gRPC.
//!
//! Nothing waits for the collector. Spans that have ended wait in a queue of a fixed length, a thread of its own sends them with a runtime of its own,
//! and what does not fit into the queue is lost. The log says once that a collector does not take spans, and once that it takes them again.

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
use zk0_tls::service_address::{ConnectError, ServiceAddress};

/// How long a collector may take for what it is sent at once.
const PATIENCE: Duration = Duration::from_secs(10);

/// How long the end of the process waits for spans that are not sent yet.
const ENDING: Duration = Duration::from_secs(2);

/// Sends the spans of this process to a collector. When it is dropped, it sends what is left, for two seconds at most.
pub struct Traces {
    provider: SdkTracerProvider,
    collector: ServiceAddress,
    /// The connection lives here. `None` only while this is dropped.
    runtime: Option<Runtime>,
}

/// Why traces cannot be sent.
#[derive(Debug, thiserror::Error)]
pub enum TracesError {
    /// The address of the collector, or whose certificates count there, is wrong.
    #[error(transparent)]
    Address(#[from] ConnectError),
    /// The system gives no thread for it.
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

    /// Traces of the service `service`, such as `zk0-node`, for this collector. It need not run yet.
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
            // Whether a span is recorded is not for whoever sends a request to say.
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

    /// What has to stand among the layers of the process's subscriber.
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
        // The log has said why, if this fails.
        let _ = self.provider.shutdown_with_timeout(ENDING);
        if let Some(runtime) = self.runtime.take() {
            runtime.shutdown_background();
        }
    }
}

/// The spans of zk0 itself. Those of the libraries, among them the ones that send spans, are for nobody, and what is logged is not sent.
fn is_ours(metadata: &Metadata<'_>) -> bool {
    metadata.is_span()
        && metadata.target().starts_with("zk0")
        && *metadata.level() <= tracing::Level::INFO
}

/// An exporter that gives up after a while, and says so once.
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
        // The thread that calls this has no runtime, and timers need one.
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
        // Nothing is being sent yet, so nobody else holds it.
        if let Some(otlp) = Arc::get_mut(&mut self.otlp) {
            otlp.set_resource(resource);
        }
    }
}
