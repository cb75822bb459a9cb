//! Groups of entries in a bucket: `PREFIX/entries/FIRST`. Beside them `PREFIX/pruned`.

use crate::blobs::entry_objects::{group_name, group_of, EntryStore, FOLDER};
use crate::blobs::error::StoreError;
use crate::bucket::Bucket;
use object_store::path::Path as ObjectPath;
use object_store::Attributes;
use zk0_protocol::pruning::MAX_PRUNING_BYTES;

/// How many bytes of a group are read. A group has fewer.
const GROUP_BYTES: u64 = 1 << 28;

impl Bucket {
    fn groups(&self) -> ObjectPath {
        self.objects.prefix.clone().join(FOLDER)
    }

    fn pruned_object(&self) -> ObjectPath {
        self.objects.prefix.clone().join("pruned")
    }

    fn group_object(&self, first: u64) -> ObjectPath {
        self.groups().join(group_name(first))
    }
}

impl EntryStore for Bucket {
    fn place(&self) -> &str {
        &self.objects.address
    }

    fn create_group(&self, first: u64, group: &[u8]) -> Result<bool, StoreError> {
        let what = format!("storing the entries from {first} on");
        self.objects.create(&what, &self.group_object(first), group)
    }

    fn group(&self, first: u64) -> Result<Option<Vec<u8>>, StoreError> {
        let what = format!("reading the entries from {first} on");
        self.objects
            .start(&what, &self.group_object(first), GROUP_BYTES)
    }

    fn groups_from(&self, from: u64) -> Result<Vec<u64>, StoreError> {
        let what = "listing the entries";
        let after = from.checked_sub(1).map(|before| self.group_object(before));
        let found = self
            .objects
            .list_after(what, &self.groups(), after.as_ref())?;
        let named = |(name, _): (ObjectPath, u64)| group_of(name.filename()?);
        let groups = found.into_iter().filter_map(named);
        Ok(groups.filter(|first| *first >= from).collect())
    }

    fn put_pruned(&self, statement: &[u8]) -> Result<(), StoreError> {
        let (what, object) = ("storing what was pruned", self.pruned_object());
        let attributes = Attributes::default();
        self.objects
            .put_bytes(what, &object, statement.to_vec(), attributes)
    }

    fn pruned(&self) -> Result<Option<Vec<u8>>, StoreError> {
        let (what, most) = ("reading what was pruned", MAX_PRUNING_BYTES as u64);
        self.objects.start(what, &self.pruned_object(), most)
    }
}
