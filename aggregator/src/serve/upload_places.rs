//! Each node has one place among the running uploads.

use crate::round::request::RequestError;
use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use zk0_circuits::NodeId;

/// The nodes that are uploading.
#[derive(Clone, Default)]
pub(super) struct UploadPlaces(Arc<Mutex<BTreeSet<NodeId>>>);

/// A node's place, until it is dropped.
pub(super) struct UploadPlace {
    node: NodeId,
    places: UploadPlaces,
}

impl UploadPlaces {
    /// Takes the node's place.
    pub fn take(&self, node: NodeId) -> Result<UploadPlace, RequestError> {
        match self.nodes().insert(node) {
            true => Ok(UploadPlace {
                node,
                places: self.clone(),
            }),
            false => Err(RequestError::Busy(format!(
                "node {node} is uploading already: it can upload one file at a time"
            ))),
        }
    }

    /// A panic elsewhere does not spoil the set: it is never half changed.
    fn nodes(&self) -> MutexGuard<'_, BTreeSet<NodeId>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for UploadPlace {
    fn drop(&mut self) {
        self.places.nodes().remove(&self.node);
    }
}
