//! Entry bundles (C2SP tlog-tiles): each item after its length (16 bits, big-endian).

/// Why bytes are not a bundle.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BundleError {
    /// An item's length exceeds 16 bits.
    #[error("an item of {0} bytes does not fit in a bundle")]
    TooLarge(usize),
    /// The bundle ends before or within an item.
    #[error("the bundle ends before the end of its item {0} (from 0)")]
    Short(usize),
    /// The bundle has bytes after its last item.
    #[error("the bundle has {0} bytes after its last item")]
    Long(usize),
}

/// Most bytes of a bundle of `width` items.
pub fn max_bytes(width: u16) -> u64 {
    u64::from(width) * (2 + u64::from(u16::MAX))
}

/// Appends an item to a bundle.
pub fn push(bundle: &mut Vec<u8>, item: &[u8]) -> Result<(), BundleError> {
    let length = u16::try_from(item.len()).map_err(|_| BundleError::TooLarge(item.len()))?;
    bundle.extend_from_slice(&length.to_be_bytes());
    bundle.extend_from_slice(item);
    Ok(())
}

/// Splits a bundle of exactly `width` items.
pub fn split(bundle: &[u8], width: u16) -> Result<Vec<&[u8]>, BundleError> {
    let mut rest = bundle;
    let mut items = Vec::with_capacity(usize::from(width).min(bundle.len() / 2));
    for at in 0..usize::from(width) {
        let short = || BundleError::Short(at);
        let (length, after) = rest.split_first_chunk::<2>().ok_or_else(short)?;
        let length = usize::from(u16::from_be_bytes(*length));
        let (item, after) = after.split_at_checked(length).ok_or_else(short)?;
        items.push(item);
        rest = after;
    }
    match rest.len() {
        0 => Ok(items),
        left => Err(BundleError::Long(left)),
    }
}
