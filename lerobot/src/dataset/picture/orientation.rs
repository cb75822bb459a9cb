//! The turn that a picture's EXIF block notes. LeRobot turns the picture by it.

/// EXIF's tag.
const ORIENTATION: u16 = 0x0112;

/// The orientation that a PNG or JPEG picture notes: 1 is upright.
pub(super) fn orientation(encoded: &[u8]) -> Option<u16> {
    match encoded {
        [0xff, 0xd8, segments @ ..] => in_jpeg(segments),
        [_, _, _, _, _, _, _, _, chunks @ ..] => in_png(chunks),
        _ => None,
    }
}

fn in_jpeg(mut rest: &[u8]) -> Option<u16> {
    while let [0xff, kind, high, low, after @ ..] = rest {
        let len = usize::from(u16::from_be_bytes([*high, *low])).checked_sub(2)?;
        let segment = after.get(..len)?;
        match (kind, segment) {
            (0xe1, [b'E', b'x', b'i', b'f', 0, 0, exif @ ..]) => return in_exif(exif),
            (0xda, _) => return None,
            _ => rest = &after[len..],
        }
    }
    None
}

fn in_png(mut rest: &[u8]) -> Option<u16> {
    while let [a, b, c, d, kind @ ..] = rest {
        let len = u32::from_be_bytes([*a, *b, *c, *d]) as usize;
        let (kind, after) = kind.split_at_checked(4)?;
        let chunk = after.get(..len)?;
        if kind == b"eXIf" {
            return in_exif(chunk);
        }
        // A four-byte checksum follows.
        rest = after.get(len + 4..)?;
    }
    None
}

/// From the first directory of EXIF's TIFF file.
fn in_exif(exif: &[u8]) -> Option<u16> {
    let big = match exif.get(..2)? {
        b"MM" => true,
        b"II" => false,
        _ => return None,
    };
    let u16_at = |at: usize| {
        let bytes: [u8; 2] = exif.get(at..at.checked_add(2)?)?.try_into().ok()?;
        Some(if big {
            u16::from_be_bytes(bytes)
        } else {
            u16::from_le_bytes(bytes)
        })
    };
    let bytes: [u8; 4] = exif.get(4..8)?.try_into().ok()?;
    let directory = if big {
        u32::from_be_bytes(bytes)
    } else {
        u32::from_le_bytes(bytes)
    } as usize;
    let entries = usize::from(u16_at(directory)?);
    (0..entries)
        .map(|entry| directory + 2 + 12 * entry)
        .find(|&at| u16_at(at) == Some(ORIENTATION))
        .and_then(|at| u16_at(at + 8))
}
