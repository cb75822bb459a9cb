//! TFRecord: the data's length (little-endian u64), a checksum of the length, the data, and a checksum of the data. Checksums are masked
//! CRC-32C: unmasked, the checksum of data that holds checksums could be constant.

use crc::{Crc, CRC_32_ISCSI};

const CRC_32C: Crc<u32> = Crc::<u32>::new(&CRC_32_ISCSI);

/// TFRecord adds this to a rotated checksum.
const MASK: u32 = 0xa282_ead8;

/// The record that holds `data`.
pub fn record(data: &[u8]) -> Vec<u8> {
    let length = (data.len() as u64).to_le_bytes();
    let mut record = Vec::with_capacity(data.len() + 16);
    record.extend(length);
    record.extend(masked_checksum(&length));
    record.extend(data);
    record.extend(masked_checksum(data));
    record
}

fn masked_checksum(bytes: &[u8]) -> [u8; 4] {
    let checksum = CRC_32C.checksum(bytes);
    checksum.rotate_right(15).wrapping_add(MASK).to_le_bytes()
}
