//! Connections of a server, counted.

use crate::connections::places::{ConnectionSlots, Counts};
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::registry::Registry;
use std::sync::{Arc, OnceLock, Weak};

/// Why a connection got no place, or lost it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ConnectionLoss {
    /// All places are taken, and nodes hold them.
    AtAll,
    /// Nodes hold all places of the address.
    OfAddress,
    /// The process can open no more files.
    OpenFiles,
    /// The TLS handshake failed, or took too long.
    Handshake,
    /// It was a stranger's, and another connection needed its place.
    MadeRoom,
}

impl ConnectionLoss {
    fn label(self) -> &'static str {
        match self {
            Self::AtAll => "max-connections",
            Self::OfAddress => "max-connections-per-address",
            Self::OpenFiles => "open-files",
            Self::Handshake => "handshake",
            Self::MadeRoom => "made-room",
        }
    }
}

/// The connections of one server.
#[derive(Clone, Default)]
pub(crate) struct ConnectionMetrics {
    places: Arc<OnceLock<Weak<ConnectionSlots>>>,
    lost: Family<[(&'static str, &'static str); 1], Counter>,
}

impl ConnectionMetrics {
    pub fn registered(registry: &mut Registry) -> Self {
        let metrics = Self::default();
        registry.register(
            "connections_lost",
            "Connections that were refused or closed, by the limit that did it",
            metrics.lost.clone(),
        );
        metrics
    }

    /// From now on, these are the places that are counted.
    pub fn watch(&self, places: &Arc<ConnectionSlots>) {
        // A server has its places once.
        let _ = self.places.set(Arc::downgrade(places));
    }

    /// A connection is lost.
    pub fn lost(&self, why: ConnectionLoss) {
        self.lost.get_or_create(&[("limit", why.label())]).inc();
    }

    /// The connections now.
    pub fn counts(&self) -> Counts {
        let places = self.places.get().and_then(Weak::upgrade);
        places.map_or_else(Counts::default, |places| places.counts())
    }
}
