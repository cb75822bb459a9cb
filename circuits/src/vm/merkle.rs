//! The Merkle tree of RFC 6962 (section 2.1) over given leaf hashes: root, inclusion path, verification.

use crate::vm::digest::{sha256, Digest};
use alloc::vec::Vec;

/// Leaf hash of `data`: `SHA-256(0x00 || data)`.
pub fn leaf_hash(data: &[u8]) -> Digest {
    sha256(&[&[0], data])
}

/// Inner node over two subtrees: `SHA-256(0x01 || left || right)`.
pub fn node_hash(left: &Digest, right: &Digest) -> Digest {
    sha256(&[&[1], &left.0, &right.0])
}

/// Merkle tree hash over `leaves`. For an empty list it is the SHA-256 of no bytes.
pub fn root(leaves: &[Digest]) -> Digest {
    match leaves {
        [] => sha256(&[]),
        [leaf] => *leaf,
        _ => {
            let (left, right) = leaves.split_at(split(leaves.len()));
            node_hash(&root(left), &root(right))
        }
    }
}

/// Returns the inclusion path of leaf `index`, from the leaf up, or `None` if there is no such leaf.
pub fn path(leaves: &[Digest], index: usize) -> Option<Vec<Digest>> {
    if index >= leaves.len() {
        return None;
    }
    let mut path = Vec::new();
    let (mut subtree, mut index) = (leaves, index);
    while subtree.len() > 1 {
        let middle = split(subtree.len());
        let (left, right) = subtree.split_at(middle);
        if index < middle {
            path.push(root(right));
            subtree = left;
        } else {
            path.push(root(left));
            subtree = right;
            index -= middle;
        }
    }
    path.reverse();
    Some(path)
}

/// Returns whether `path` proves that the tree of `size` leaves with this `root` has leaf hash `leaf` at `index` (RFC 9162,
/// section 2.1.3.2). A path for another position or another size does not verify.
pub fn verify(root: &Digest, size: u64, index: u64, leaf: &Digest, path: &[Digest]) -> bool {
    if index >= size {
        return false;
    }
    let (mut node, mut last) = (index, size - 1);
    let mut hash = *leaf;
    for sibling in path {
        if last == 0 {
            return false;
        }
        if node & 1 == 1 || node == last {
            hash = node_hash(sibling, &hash);
            while node & 1 == 0 && node != 0 {
                node >>= 1;
                last >>= 1;
            }
        } else {
            hash = node_hash(&hash, sibling);
        }
        node >>= 1;
        last >>= 1;
    }
    last == 0 && hash == *root
}

/// Largest power of two below `count`, for `count` ≥ 2.
fn split(count: usize) -> usize {
    1 << (count - 1).ilog2()
}
