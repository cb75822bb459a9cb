//! Serves a ledger's folder as a tiled log (C2SP tlog-tiles), read-only.

use crate::line::WorkQueue;
use crate::publish::file_answer::{begins, file_answer, file_head};
use crate::publish::http::{answer, text, HttpLimits, Router, IMMUTABLE, NO_CACHE, TEXT};
use axum::extract::State;
use axum::http::header::RETRY_AFTER;
use axum::http::{HeaderMap, Method, Uri};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use std::collections::BTreeSet;
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use tokio::fs::File;
use tokio::task::spawn_blocking;
use zk0_circuits::Digest;
use zk0_ledger::blobs::Blobs;
use zk0_ledger::published::publication::{Content, Publication, PublicationError};
use zk0_protocol::tlog::layout::Resource;

const BINARY: &str = "application/octet-stream";

/// Requests that may read blobs from the store at once.
const READING: usize = 8;

/// How many more may wait. They hold no thread.
const WAITING: usize = 64;

/// In seconds.
const ASK_AGAIN: &str = "5";

/// Serves one folder.
pub struct LogServer {
    dir: PathBuf,
    blobs: Blobs,
    reading: WorkQueue,
    /// Bytes of blobs in the folder; `None` for no limit.
    cache_bytes: Option<u64>,
    held: Mutex<Option<Arc<Publication>>>,
}

impl LogServer {
    /// Serves the log in `dir`, which may be unpublished yet.
    pub fn new(dir: &Path) -> Self {
        Self {
            dir: dir.into(),
            blobs: Blobs::at(dir),
            reading: WorkQueue::new(READING, WAITING),
            cache_bytes: None,
            held: Mutex::new(None),
        }
    }

    /// Reads the blobs as they are kept: perhaps in a store.
    pub fn with_blobs(self, blobs: Blobs) -> Self {
        Self { blobs, ..self }
    }

    /// Bounds the blobs in the folder, in bytes, after each read from the store. Not for an aggregator's folder.
    pub fn with_blob_cache(self, bytes: u64) -> Self {
        Self {
            cache_bytes: Some(bytes),
            ..self
        }
    }

    /// The log's routes.
    pub fn router(self, limits: HttpLimits) -> Router {
        Router::new()
            .fallback(get(read).fallback(|| async { text(405, "a log can only be read\n") }))
            .with_state((Arc::new(self), limits))
    }

    /// What is published now.
    pub fn newest(&self) -> Result<Arc<Publication>, PublicationError> {
        let mut held = self.held.lock().unwrap_or_else(PoisonError::into_inner);
        match held.as_ref() {
            Some(publication) if publication.is_current()? => Ok(publication.clone()),
            before => {
                let before = before.map(|publication| &**publication);
                let new = Publication::open(&self.dir, before)?;
                let new = Arc::new(new.with_blobs(self.blobs.clone()));
                *held = Some(new.clone());
                Ok(new)
            }
        }
    }

    /// What was published at the last request for a checkpoint. It holds all that a reader of that checkpoint asks for.
    fn recent(&self) -> Result<Arc<Publication>, PublicationError> {
        let held = self.held.lock().unwrap_or_else(PoisonError::into_inner);
        match held.as_ref() {
            Some(publication) => Ok(publication.clone()),
            None => {
                drop(held);
                self.newest()
            }
        }
    }

    fn content(&self, resource: &Resource) -> Result<Option<Content>, PublicationError> {
        if matches!(
            resource,
            Resource::Checkpoint | Resource::Policy | Resource::Pruned
        ) {
            return Ok(self.newest()?.read(resource)?);
        }
        match self.recent()?.read(resource)? {
            Some(content) => Ok(Some(content)),
            // The reader may have a newer checkpoint from elsewhere.
            None => Ok(self.newest()?.read(resource)?),
        }
    }

    /// In bytes, without reading the store.
    fn blob_size(&self, blob: &Digest) -> Result<Option<u64>, PublicationError> {
        match self.recent()?.blob_size(blob) {
            Some(size) => Ok(Some(size)),
            None => Ok(self.newest()?.blob_size(blob)),
        }
    }

    fn shrink(&self) {
        let Some(limit) = self.cache_bytes else {
            return;
        };
        if let Err(error) = self.blobs.shrink(limit, &BTreeSet::new()) {
            tracing::error!("the blobs in the ledger's folder stay: {error}");
        }
    }
}

async fn read(
    State((server, limits)): State<(Arc<LogServer>, HttpLimits)>,
    method: Method,
    headers: HeaderMap,
    address: Uri,
) -> Response {
    let path = address.path();
    let Some(resource) = Resource::parse(path.strip_prefix('/').unwrap_or(path)) else {
        return text(404, "a log has no such file\n");
    };
    let (kind, cache) = match resource {
        Resource::Checkpoint | Resource::Policy => (TEXT, NO_CACHE),
        Resource::Pruned => (BINARY, NO_CACHE),
        Resource::Tile(_) | Resource::Blob(_) => (BINARY, IMMUTABLE),
    };
    let failed = |error: &dyn std::fmt::Display| {
        // The error names paths, which are for the operator.
        tracing::error!("{error}");
        text(500, "the log cannot be read; its operator's log says why\n")
    };
    const NOT_PUBLISHED: &str = "this file is not published, or not yet\n";
    if let (&Method::HEAD, Resource::Blob(blob)) = (&method, &resource) {
        let (reader, blob) = (server.clone(), *blob);
        return match spawn_blocking(move || reader.blob_size(&blob)).await {
            Ok(Ok(Some(size))) => file_head(size, kind),
            Ok(Ok(None)) => text(404, NOT_PUBLISHED),
            Ok(Err(error)) => failed(&error),
            Err(error) => failed(&error),
        };
    }
    let place = match &resource {
        Resource::Blob(blob) if !server.blobs.is_here(blob) => match server.reading.place().await {
            Some(place) => Some(place),
            None => {
                let why =
                    "too many wait for files that are only in the blob store: ask again later\n";
                return ([(RETRY_AFTER, ASK_AGAIN)], text(503, why)).into_response();
            }
        },
        _ => None,
    };
    let reader = server.clone();
    let content = spawn_blocking(move || {
        let content = reader.content(&resource);
        if place.is_some() {
            // The answer's blob is open by now.
            reader.shrink();
        }
        // Taken until the thread is free, even if the reader has left.
        drop(place);
        content
    });
    let content = match content.await {
        Ok(content) => content,
        Err(error) => return failed(&error),
    };
    let begins = begins(&method, &headers);
    match content {
        // What changes is small, and its rest may be another version's.
        Ok(Some(Content::Bytes(bytes))) if cache == NO_CACHE => answer(200, kind, cache, bytes),
        Ok(Some(Content::Bytes(bytes))) => {
            let length = bytes.len() as u64;
            let sent = file_answer(Cursor::new(bytes), length, begins, kind, &limits).await;
            sent.unwrap_or_else(|error| failed(&format_args!("{path}: {error}")))
        }
        Ok(Some(Content::File(file))) => {
            let sent = match file.metadata() {
                Ok(about) => {
                    let file = File::from_std(file);
                    file_answer(file, about.len(), begins, kind, &limits).await
                }
                Err(error) => Err(error),
            };
            sent.unwrap_or_else(|error| failed(&format_args!("{path}: {error}")))
        }
        Ok(None) => text(404, NOT_PUBLISHED),
        Err(PublicationError::NotCosigned(_)) => text(
            503,
            "nothing is published before the witnesses have cosigned a checkpoint\n",
        ),
        Err(error) => failed(&error),
    }
}
