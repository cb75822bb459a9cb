//! Boxes and big-endian fields of an mp4, never read past their container.

pub(crate) type Result<T> = std::result::Result<T, String>;

pub(crate) struct BoxHeader {
    pub kind: [u8; 4],
    /// Bytes of header.
    pub header: u64,
    /// Bytes of header and body, at most those available.
    pub len: u64,
}

impl BoxHeader {
    pub fn parse(bytes: &[u8], available: u64) -> Result<Self> {
        let mut fields = Fields(bytes);
        let size = fields.u32()?;
        let mut kind = [0; 4];
        kind.copy_from_slice(fields.take(4)?.0);
        let (header, len) = match size {
            0 => (8, available), // up to the end
            1 => (16, fields.u64()?),
            _ => (8, size.into()),
        };
        if len < header || len > available {
            return Err(format!(
                "box {:?} of {len} bytes where {available} are left",
                String::from_utf8_lossy(&kind)
            ));
        }
        Ok(Self { kind, header, len })
    }
}

/// Consecutive boxes of a byte string; ends after the first error.
pub(crate) struct Boxes<'a>(pub &'a [u8]);

impl<'a> Iterator for Boxes<'a> {
    type Item = Result<([u8; 4], &'a [u8])>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.0.len() < 8 {
            return None;
        }
        let all = std::mem::take(&mut self.0);
        let header = match BoxHeader::parse(all, all.len() as u64) {
            Ok(header) => header,
            Err(e) => return Some(Err(e)),
        };
        let (this, rest) = all.split_at(header.len as usize);
        self.0 = rest;
        Some(Ok((header.kind, &this[header.header as usize..])))
    }
}

pub(crate) fn find<'a>(parent: &'a [u8], kind: &[u8; 4]) -> Result<Option<&'a [u8]>> {
    for child in Boxes(parent) {
        let (found, body) = child?;
        if &found == kind {
            return Ok(Some(body));
        }
    }
    Ok(None)
}

pub(crate) fn required<'a>(parent: &'a [u8], kind: &[u8; 4]) -> Result<&'a [u8]> {
    find(parent, kind)?.ok_or_else(|| format!("has no {} box", String::from_utf8_lossy(kind)))
}

/// Big-endian fields of a byte string.
pub(crate) struct Fields<'a>(pub &'a [u8]);

impl<'a> Fields<'a> {
    pub fn take(&mut self, n: usize) -> Result<Fields<'a>> {
        let (taken, rest) = self.0.split_at_checked(n).ok_or("a box ends too early")?;
        self.0 = rest;
        Ok(Fields(taken))
    }

    pub fn skip(mut self, n: usize) -> Result<Self> {
        self.take(n)?;
        Ok(self)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N]> {
        let mut bytes = [0; N];
        bytes.copy_from_slice(self.take(N)?.0);
        Ok(bytes)
    }

    pub fn u8(&mut self) -> Result<u8> {
        self.array().map(u8::from_be_bytes)
    }

    pub fn u16(&mut self) -> Result<u16> {
        self.array().map(u16::from_be_bytes)
    }

    pub fn u32(&mut self) -> Result<u32> {
        self.array().map(u32::from_be_bytes)
    }

    pub fn u64(&mut self) -> Result<u64> {
        self.array().map(u64::from_be_bytes)
    }
}
