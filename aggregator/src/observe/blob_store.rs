//! Metrics of the blobs and their store.

use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, SystemTime};
use zk0_ledger::blobs::usage::{Amount, StoreOperation};
use zk0_ledger::blobs::Blobs;
use zk0_service::metrics::registry::{gauged, MetricRegistry};

type Labels<const COUNT: usize> = [(&'static str, &'static str); COUNT];

#[derive(Clone, Default)]
pub(super) struct BlobMetrics {
    /// When the folder had changed last, at the last look at its files.
    looked: Arc<Mutex<Option<SystemTime>>>,
    blobs: Family<Labels<1>, Gauge>,
    bytes: Family<Labels<1>, Gauge>,
    operations: Family<Labels<2>, Counter>,
    seconds: Family<Labels<1>, Counter<f64, AtomicU64>>,
    moved: Family<Labels<1>, Counter>,
    failing: Gauge,
    uploads: Family<Labels<1>, Counter>,
}

impl BlobMetrics {
    pub fn registered(registry: &mut MetricRegistry) -> Self {
        let new = Self::default();
        registry.register(
            "blobs",
            "Blobs: in the ledger's folder, and in the blob store",
            new.blobs.clone(),
        );
        registry.register(
            "blob_bytes",
            "Bytes of the blobs: in the ledger's folder, and in the blob store",
            new.bytes.clone(),
        );
        registry.register(
            "blob_store_operations",
            "What the blob store was asked for, and how that ended, after all tries",
            new.operations.clone(),
        );
        registry.register(
            "blob_store_operation_seconds",
            "Time that the blob store took for it, with all tries",
            new.seconds.clone(),
        );
        registry.register(
            "blob_store_moved_bytes",
            "Bytes of blobs that were stored and read",
            new.moved.clone(),
        );
        registry.register(
            "blob_store_failing_seconds",
            "For how long the blob store has failed whatever it was asked for; 0 if it answered last, or if there is none",
            new.failing.clone(),
        );
        registry.register(
            "uploads",
            "Updates that came to their end: in messages of their nodes, and from the blob store, where nodes had put them",
            new.uploads.clone(),
        );
        new
    }

    /// An update is complete.
    pub fn uploaded(&self, from: &'static str) {
        self.uploads.get_or_create(&[("from", from)]).inc();
    }

    /// Takes the present values. Reads the folder if it has changed.
    pub fn take(&self, blobs: &Blobs) {
        let held = |place: &'static str, amount: Amount| {
            let label = [("are", place)];
            self.blobs.get_or_create(&label).set(gauged(amount.blobs));
            self.bytes.get_or_create(&label).set(gauged(amount.bytes));
        };
        let mut looked = self.looked.lock().unwrap_or_else(PoisonError::into_inner);
        let changed = blobs.changed();
        if changed.is_none() || changed != *looked {
            // If the folder cannot be read, the last numbers stay.
            if let Ok(here) = blobs.here() {
                held("here", here);
                *looked = changed;
            }
        }
        drop(looked);
        let (Some(stored), Some(usage)) = (blobs.stored(), blobs.usage()) else {
            return;
        };
        held("stored", stored);
        let failing = usage.failing().map_or(0, |since| since.as_secs());
        self.failing.set(gauged(failing));
        for operation in StoreOperation::ALL {
            let (name, count) = (operation.name(), usage.of(operation));
            let ended = |how: &'static str, number: u64| {
                let labels = [("operation", name), ("ended", how)];
                let counter = self.operations.get_or_create(&labels);
                counter.inner().store(number, Ordering::Relaxed);
            };
            ended("done", count.done);
            ended("failed", count.failed);
            ended("altered", count.altered);
            let label = [("operation", name)];
            let seconds = Duration::as_secs_f64(&count.time).to_bits();
            let time = self.seconds.get_or_create(&label);
            time.inner().store(seconds, Ordering::Relaxed);
            if matches!(operation, StoreOperation::Put | StoreOperation::Get) {
                let moved = self.moved.get_or_create(&label);
                moved.inner().store(count.bytes, Ordering::Relaxed);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::{self, File};
    use std::time::UNIX_EPOCH;

    #[test]
    fn the_files_are_looked_at_when_the_folder_has_changed() {
        let dir = tempfile::tempdir().unwrap();
        let blobs = Blobs::at(dir.path());
        let metrics = BlobMetrics::default();
        let shown = || {
            metrics.take(&blobs);
            metrics.blobs.get_or_create(&[("are", "here")]).get()
        };
        blobs.put(b"one").unwrap();
        let path = dir.path().join("blobs/sha256");
        let folder = File::open(&path).unwrap();
        let past = UNIX_EPOCH + Duration::from_secs(1_700_000_000);
        folder.set_modified(past).unwrap();
        assert_eq!(shown(), 1);
        // This one could be seen only by a look at the files.
        fs::write(path.join("00".repeat(32)), "two").unwrap();
        folder.set_modified(past).unwrap();
        assert_eq!(shown(), 1);
        blobs.put(b"three").unwrap();
        assert_eq!(shown(), 3);
    }
}
