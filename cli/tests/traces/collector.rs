//! A collector of traces: it receives spans by OTLP over gRPC, and keeps them in memory.

use crate::harness::network::LocalNetwork;
use opentelemetry_proto::tonic::collector::trace::v1::trace_service_server::{
    TraceService, TraceServiceServer,
};
use opentelemetry_proto::tonic::collector::trace::v1::{
    ExportTraceServiceRequest, ExportTraceServiceResponse,
};
use opentelemetry_proto::tonic::common::v1::any_value::Value;
use opentelemetry_proto::tonic::common::v1::KeyValue;
use opentelemetry_proto::tonic::trace::v1::Span;
use std::sync::{Arc, Mutex};
use tokio::net::TcpListener;
use tokio::runtime::Runtime;
use tokio_stream::wrappers::TcpListenerStream;
use tonic::transport::Server;
use tonic::{Request, Response, Status};
use zk0_service::tls::incoming::{connections, Bounds};
use zk0_service::tls::server_certificate::ServerCertificate;
use zk0_testkit::until;

/// A span, and the service that has sent it.
#[derive(Clone, Debug)]
pub struct Traced {
    pub service: String,
    pub span: Span,
}

/// What a collector has received.
#[derive(Clone, Default)]
struct Received(Arc<Mutex<Vec<Traced>>>);

#[tonic::async_trait]
impl TraceService for Received {
    async fn export(
        &self,
        request: Request<ExportTraceServiceRequest>,
    ) -> Result<Response<ExportTraceServiceResponse>, Status> {
        for of_process in request.into_inner().resource_spans {
            let about = of_process.resource.unwrap().attributes;
            let service = text(&about, "service.name").unwrap();
            let scopes = of_process.scope_spans.into_iter();
            let spans = scopes.flat_map(|scope| scope.spans);
            self.0.lock().unwrap().extend(spans.map(|span| Traced {
                service: service.clone(),
                span,
            }));
        }
        Ok(Response::new(ExportTraceServiceResponse::default()))
    }
}

/// A running collector.
pub struct Collector {
    pub address: String,
    received: Received,
    _runtime: Runtime,
}

impl Collector {
    pub fn start() -> Self {
        Self::on("127.0.0.1:0", None)
    }

    /// A collector that listens on this address, over TLS if there is a certificate.
    pub fn on(address: &str, certificate: Option<Arc<ServerCertificate>>) -> Self {
        let runtime = Runtime::new().unwrap();
        let received = Received::default();
        let service = TraceServiceServer::new(received.clone());
        let address = runtime.block_on(async {
            let listener = TcpListener::bind(address).await.unwrap();
            let address = listener.local_addr().unwrap();
            let server = Server::builder().add_service(service);
            match certificate {
                Some(certificate) => {
                    let tls = Some(certificate.acceptor("h2"));
                    let connections = connections(listener, tls, Bounds::default());
                    tokio::spawn(server.serve_with_incoming(connections));
                    format!("https://{address}")
                }
                None => {
                    let connections = TcpListenerStream::new(listener);
                    tokio::spawn(server.serve_with_incoming(connections));
                    format!("http://{address}")
                }
            }
        });
        Self {
            address,
            received,
            _runtime: runtime,
        }
    }

    /// The spans so far.
    pub fn spans(&self) -> Spans {
        Spans(self.received.0.lock().unwrap().clone())
    }

    /// Waits until there is a span of this name.
    #[track_caller]
    pub fn receives(&self, name: &str) {
        until(format!("a span is named {name:?}"), || {
            !self.spans().named(name).is_empty()
        });
    }
}

/// Spans that were received.
pub struct Spans(pub Vec<Traced>);

impl Spans {
    fn names(&self) -> Vec<&str> {
        let names = self.0.iter().map(|one| &*one.span.name);
        names.collect()
    }

    pub fn named(&self, name: &str) -> Vec<&Traced> {
        let named = self.0.iter().filter(|one| one.span.name == name);
        named.collect()
    }

    /// The one span of this name.
    #[track_caller]
    pub fn one(&self, service: &str, name: &str) -> &Span {
        let found = self.named(name);
        assert_eq!(found.len(), 1, "{name}: {:?}", self.names());
        assert_eq!(found[0].service, service, "{name}");
        &found[0].span
    }

    /// The spans of this name right below `parent`, in its trace.
    pub fn children<'a>(&'a self, parent: &Span, name: &str) -> Vec<&'a Traced> {
        let mut named = self.named(name);
        named.retain(|one| {
            one.span.parent_span_id == parent.span_id && one.span.trace_id == parent.trace_id
        });
        named
    }

    /// The one span of this name right below `parent`. It lies within its parent's time.
    #[track_caller]
    pub fn child(&self, parent: &Span, service: &str, name: &str) -> &Span {
        let found = self.children(parent, name);
        assert_eq!(found.len(), 1, "{name}: {:?}", self.names());
        assert_eq!(found[0].service, service, "{name}");
        let span = &found[0].span;
        assert!(
            parent.start_time_unix_nano <= span.start_time_unix_nano,
            "{name}"
        );
        span
    }
}

/// The attribute of this name, as text.
pub fn text(attributes: &[KeyValue], key: &str) -> Option<String> {
    let found = attributes.iter().find(|one| one.key == key)?;
    match found.value.as_ref()?.value.as_ref()? {
        Value::StringValue(text) => Some(text.clone()),
        Value::IntValue(number) => Some(number.to_string()),
        other => panic!("{key}: {other:?}"),
    }
}

/// A founded network, and the arguments that serve it and send its traces to `collector`.
pub fn serving(network: &LocalNetwork, collector: &str) -> Vec<String> {
    let (ledger, key) = (network.path("ledger"), network.path("log.key"));
    let words = ["aggregator", "serve", &ledger, "--key", &key];
    let more = ["--listen", "127.0.0.1:0", "--otlp", collector];
    words.iter().chain(&more).map(ToString::to_string).collect()
}
