//! Serves a ledger's folder as a tiled log (C2SP tlog-tiles), read-only.

use crate::growing_file::GrowingFile;
use crate::line::WorkQueue;
use crate::publish::file_answer::{begins, file_answer, file_head};
use crate::publish::http::{answer, text, HttpLimits, Router, IMMUTABLE, NO_CACHE, TEXT};
use crate::store_reads::StoreReads;
use axum::extract::State;
use axum::http::header::RETRY_AFTER;
use axum::http::{HeaderMap, Method, Uri};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use std::fmt::Display;
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use tokio::fs::File;
use tokio::task::spawn_blocking;
use zk0_circuits::Digest;
use zk0_ledger::blobs::{BlobError, Blobs};
use zk0_ledger::published::publication::{Content, Publication, PublicationError};
use zk0_protocol::tlog::layout::Resource;

const BINARY: &str = "application/octet-stream";

/// Requests that may read blobs from the store at once.
const READING: usize = 8;

/// How many more may wait. They hold no thread.
const WAITING: usize = 64;

/// In seconds.
const ASK_AGAIN: &str = "5";

const NOT_PUBLISHED: &str = "this file is not published, or not yet\n";

/// Serves one folder.
pub struct LogServer {
    dir: PathBuf,
    blobs: Blobs,
    reading: WorkQueue,
    reads: StoreReads,
    held: Mutex<Option<Arc<Publication>>>,
}

impl LogServer {
    /// Serves the log in `dir`, which may be unpublished yet.
    pub fn new(dir: &Path) -> Self {
        Self {
            dir: dir.into(),
            blobs: Blobs::at(dir),
            reading: WorkQueue::new(READING, WAITING),
            reads: StoreReads::default(),
            held: Mutex::new(None),
        }
    }

    /// Reads the blobs as they are kept, perhaps in a store.
    pub fn with_blobs(self, blobs: Blobs) -> Self {
        Self { blobs, ..self }
    }

    /// Bounds the blobs in the folder, in bytes, after each read from the store. Not for an aggregator's folder.
    pub fn with_blob_cache(mut self, bytes: u64) -> Self {
        self.reads.cache_bytes = Some(bytes);
        self
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

    /// What was published at the last request for a checkpoint: all that its reader asks for.
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

    fn publishes(&self, blob: &Digest) -> Result<bool, PublicationError> {
        Ok(self.recent()?.is_public(blob) || self.newest()?.is_public(blob))
    }

    /// The file of a blob that is only in the store, or the answer that it cannot be had.
    async fn from_store(self: &Arc<Self>, blob: Digest) -> Result<GrowingFile, Response> {
        let reader = self.clone();
        match spawn_blocking(move || reader.publishes(&blob)).await {
            Ok(Ok(true)) => {}
            Ok(Ok(false)) => return Err(text(404, NOT_PUBLISHED)),
            Ok(Err(error)) => return Err(unreadable(&error)),
            Err(error) => return Err(failed(&error)),
        }
        let Some(place) = self.reading.place().await else {
            let why = "too many wait for files that are only in the blob store: ask again later\n";
            return Err(([(RETRY_AFTER, ASK_AGAIN)], text(503, why)).into_response());
        };
        let file = self.reads.open(&self.blobs, blob, place).await;
        file.map_err(|error| match &*error {
            BlobError::Missing(_) => text(404, NOT_PUBLISHED),
            error => failed(error),
        })
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
    if let (&Method::HEAD, Resource::Blob(blob)) = (&method, &resource) {
        let (reader, blob) = (server.clone(), *blob);
        return match spawn_blocking(move || reader.blob_size(&blob)).await {
            Ok(Ok(Some(size))) => file_head(size, kind),
            Ok(Ok(None)) => text(404, NOT_PUBLISHED),
            Ok(Err(error)) => failed(&error),
            Err(error) => failed(&error),
        };
    }
    let begins = begins(&method, &headers);
    let away = match resource {
        Resource::Blob(blob) => Some(blob).filter(|blob| !server.blobs.is_here(blob)),
        _ => None,
    };
    if let Some(blob) = away {
        let file = match server.from_store(blob).await {
            Ok(file) => file,
            Err(refused) => return refused,
        };
        let length = file.size();
        let sent = file_answer(file, length, begins, kind, &limits).await;
        return sent.unwrap_or_else(|error| failed(&format_args!("{path}: {error}")));
    }
    let reader = server.clone();
    let content = match spawn_blocking(move || reader.content(&resource)).await {
        Ok(content) => content,
        Err(error) => return failed(&error),
    };
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
        Err(error) => unreadable(&error),
    }
}

/// The log cannot be read. The error names paths, for the operator only.
fn failed(error: &dyn Display) -> Response {
    tracing::error!("{error}");
    text(
        500,
        "the log cannot be read; its operator's log states why\n",
    )
}

fn unreadable(error: &PublicationError) -> Response {
    match error {
        PublicationError::NotCosigned(_) => text(
            503,
            "nothing is published before the witnesses have cosigned a checkpoint\n",
        ),
        error => failed(error),
    }
}
