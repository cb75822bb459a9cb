//! Serves a ledger's folder as a tiled log (C2SP tlog-tiles), read-only, beside the aggregator that writes it or instead of it.

use crate::publish::http::{Body, Call, Handler, Reply, BINARY, IMMUTABLE, NO_CACHE, TEXT};
use hyper::Method;
use std::{
    path::{Path, PathBuf},
    sync::{Arc, Mutex, PoisonError},
};
use zk0_ledger::published::publication::{Content, Publication, PublicationError};
use zk0_protocol::tlog::layout::Resource;

/// Serves one folder.
pub struct LogServer {
    dir: PathBuf,
    view: Mutex<Option<Arc<Publication>>>,
}

impl LogServer {
    /// Serves the log in `dir`. Nothing need be published there yet.
    pub fn new(dir: &Path) -> Self {
        Self {
            dir: dir.into(),
            view: Mutex::new(None),
        }
    }

    /// What is published now.
    pub fn newest(&self) -> Result<Arc<Publication>, PublicationError> {
        let mut held = self.view.lock().unwrap_or_else(PoisonError::into_inner);
        match held.as_ref() {
            Some(view) if view.is_current()? => Ok(view.clone()),
            before => {
                let new = Arc::new(Publication::open(&self.dir, before.map(|view| &**view))?);
                *held = Some(new.clone());
                Ok(new)
            }
        }
    }

    /// What was published when a checkpoint was last asked for: all that such a client goes on to ask for is in it.
    fn recent(&self) -> Result<Arc<Publication>, PublicationError> {
        let held = self.view.lock().unwrap_or_else(PoisonError::into_inner);
        match held.as_ref() {
            Some(view) => Ok(view.clone()),
            None => {
                drop(held);
                self.newest()
            }
        }
    }

    fn content(&self, resource: &Resource) -> Result<Option<Content>, PublicationError> {
        if matches!(resource, Resource::Checkpoint | Resource::Policy) {
            return Ok(self.newest()?.read(resource)?);
        }
        match self.recent()?.read(resource)? {
            Some(content) => Ok(Some(content)),
            // Perhaps published meanwhile, and told by somebody else.
            None => Ok(self.newest()?.read(resource)?),
        }
    }
}

impl Handler for LogServer {
    fn answer(&self, call: &Call) -> Reply {
        if call.method != Method::GET && call.method != Method::HEAD {
            return Reply::text(405, "a log is only read\n");
        }
        let Some(resource) = Resource::parse(&call.path) else {
            return Reply::text(404, "a log has no such file\n");
        };
        let body = match self.content(&resource) {
            Ok(Some(Content::Bytes(bytes))) => Body::Bytes(bytes),
            Ok(Some(Content::File(path))) => Body::File(path),
            Ok(None) => return Reply::text(404, "not published, or not yet\n"),
            Err(PublicationError::NotCosigned(_)) => {
                return Reply::text(
                    503,
                    "nothing is published before the witnesses have cosigned\n",
                )
            }
            Err(error) => {
                // Paths and the like are for the operator.
                tracing::error!("{error}");
                return Reply::text(500, "the log cannot be read; its operator's log says why\n");
            }
        };
        let (kind, cache) = match resource {
            Resource::Checkpoint | Resource::Policy => (TEXT, NO_CACHE),
            Resource::Tile(_) | Resource::Blob(_) => (BINARY, IMMUTABLE),
        };
        Reply {
            status: 200,
            kind,
            cache,
            body,
        }
    }
}
