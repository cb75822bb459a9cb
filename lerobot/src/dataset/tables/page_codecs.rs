//! Compressed pages whose codec does not stop at the size in the page's header.
//!
//! The parquet crate decompresses gzip, Brotli and LZ4 frames to their end, whatever the size. So these are first decompressed and counted
//! in pieces. Snappy, zstd and LZ4 blocks stop at the claimed size.

use std::io::{BufReader, Read};

use parquet::basic::Compression;

use crate::dataset::tables::fault::ParquetFault;

/// Size of a counted piece.
const PIECE: usize = 16 << 10;
/// First byte, without its highest bit, of a Brotli stream with a window beyond 16 MiB, up to 1 GiB.
const BROTLI_LARGE_WINDOW: u8 = 0x11;
/// How LZ4 frames begin. Parquet has LZ4 blocks; only some old Rust writers made frames.
const LZ4_FRAMES: [[u8; 4]; 2] = [[0x04, 0x22, 0x4d, 0x18], [0x02, 0x21, 0x4c, 0x18]];

/// Checks that `page` decompresses to at most `claimed` bytes.
pub(super) fn check(codec: Compression, page: impl Read, claimed: u64) -> Result<(), ParquetFault> {
    let mut page = BufReader::with_capacity(PIECE, page);
    match codec {
        Compression::GZIP(_) => count(flate2::read::MultiGzDecoder::new(page), claimed),
        Compression::BROTLI(_) => {
            let mut first = [0];
            page.read_exact(&mut first)?;
            if first[0] & 0x7f == BROTLI_LARGE_WINDOW {
                let cause = "Brotli with a window beyond 16 MiB";
                return Err(ParquetFault::NotSupported(cause.into()));
            }
            let all = first.chain(page);
            count(brotli::Decompressor::new(all, PIECE), claimed)
        }
        Compression::LZ4 => {
            let mut first = Vec::new();
            page.take(4).read_to_end(&mut first)?;
            if LZ4_FRAMES.iter().any(|magic| *magic == first[..]) {
                Err(ParquetFault::NotSupported(
                    "LZ4 frames in place of blocks".into(),
                ))
            } else {
                Ok(())
            }
        }
        _ => Ok(()),
    }
}

fn count(mut content: impl Read, claimed: u64) -> Result<(), ParquetFault> {
    let mut piece = vec![0; PIECE];
    let mut found = 0u64;
    loop {
        match content.read(&mut piece)? {
            0 => return Ok(()),
            n => found += n as u64,
        }
        if found > claimed {
            return Err(format!("a page claims {claimed} bytes and holds more").into());
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    const MIB: usize = 1 << 20;

    fn gzip(len: usize) -> Vec<u8> {
        let mut out = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        (0..len / MIB).for_each(|_| out.write_all(&vec![0; MIB]).unwrap());
        out.finish().unwrap()
    }

    fn brotli(len: usize) -> Vec<u8> {
        let mut out = brotli::CompressorWriter::new(Vec::new(), 4096, 1, 22);
        (0..len / MIB).for_each(|_| out.write_all(&vec![0; MIB]).unwrap());
        out.into_inner()
    }

    #[test]
    fn what_becomes_more_than_it_claims_is_refused() {
        let more = |claimed: usize| {
            Err(ParquetFault::Damaged(format!(
                "a page claims {claimed} bytes and holds more"
            )))
        };
        for (codec, page) in [
            (Compression::GZIP(Default::default()), gzip(40 * MIB)),
            (Compression::BROTLI(Default::default()), brotli(40 * MIB)),
        ] {
            assert!(page.len() < MIB);
            assert_eq!(check(codec, &page[..], 40 * MIB as u64), Ok(()));
            for claimed in [40 * MIB - 1, MIB, 1] {
                assert_eq!(check(codec, &page[..], claimed as u64), more(claimed));
            }
        }
        // Several streams count as one.
        let twice = [gzip(MIB), gzip(MIB)].concat();
        let codec = Compression::GZIP(Default::default());
        assert_eq!(check(codec, &twice[..], 2 * MIB as u64), Ok(()));
        assert_eq!(check(codec, &twice[..], MIB as u64), more(MIB));
    }

    #[test]
    fn a_window_of_brotli_beyond_16_mib_is_refused() {
        let params = brotli::enc::BrotliEncoderParams {
            large_window: true,
            lgwin: 30,
            ..Default::default()
        };
        let mut page = Vec::new();
        brotli::BrotliCompress(&mut &[7; 1000][..], &mut page, &params).unwrap();
        let found = check(Compression::BROTLI(Default::default()), &page[..], 1000);
        assert!(
            matches!(found, Err(ParquetFault::NotSupported(_))),
            "{found:?}"
        );
    }

    #[test]
    fn lz4_frames_are_refused() {
        for first in LZ4_FRAMES {
            let found = check(Compression::LZ4, &[&first[..], &[0; 9]].concat()[..], 9);
            assert!(
                matches!(found, Err(ParquetFault::NotSupported(_))),
                "{found:?}"
            );
        }
        assert_eq!(check(Compression::LZ4, &[0xf1, 0x1f, 2][..], 9), Ok(()));
        assert_eq!(check(Compression::LZ4, &[][..], 9), Ok(()));
    }
}
