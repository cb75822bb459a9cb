//! The part of the mp4 container (ISO/IEC 14496-12, AV1 in ISOBMFF) that a LeRobot video uses: where each frame's bytes
//! are and when it is shown.
//!
//! Written here rather than taken from a crate because it reads files that may be damaged: every length is checked
//! against what holds it before it is believed, so no input panics or allocates beyond a small multiple of the file.

use std::io::{Read, Seek, SeekFrom};

/// Largest `moov` box read into memory; a million frames take about 10 MB.
const MAX_MOOV: u64 = 64 << 20;
const MAX_SAMPLES: usize = 10_000_000;

/// The first video track of a file.
#[derive(Debug, Clone, PartialEq)]
pub struct Mp4Track {
    /// Pixels from left to right, as the sample description declares.
    pub width: usize,
    /// Pixels from top to bottom.
    pub height: usize,
    /// Frames in decoding order, which for AV1 is the order of presentation.
    pub samples: Vec<Mp4Sample>,
}

/// One encoded frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mp4Sample {
    /// First byte in the file; `offset + size` is within the file.
    pub offset: u64,
    /// Number of bytes, at least 1.
    pub size: u32,
    /// Second at which the frame is shown.
    pub time: f64,
    /// Whether decoding can start here.
    pub key: bool,
}

type Result<T> = std::result::Result<T, String>;

impl Mp4Track {
    /// Reads the track of an unfragmented mp4 with AV1 video.
    ///
    /// # Errors
    /// What is wrong with the file, in words.
    pub fn read(file: &mut (impl Read + Seek)) -> Result<Self> {
        let io = |e: std::io::Error| format!("cannot be read: {e}");
        let file_len = file.seek(SeekFrom::End(0)).map_err(io)?;
        let mut at = 0;
        while at + 8 <= file_len {
            let mut head = [0; 16];
            let head_len = (file_len - at).min(16) as usize;
            file.seek(SeekFrom::Start(at)).map_err(io)?;
            file.read_exact(&mut head[..head_len]).map_err(io)?;
            let found = BoxHeader::parse(&head[..head_len], file_len - at)
                .map_err(|e| format!("{e} at byte {at}; is the file cut off or not an mp4?"))?;
            match &found.kind {
                b"moov" if found.len > MAX_MOOV => {
                    return Err(format!(
                        "index (moov) of {} bytes, at most {MAX_MOOV} are read",
                        found.len
                    ))
                }
                b"moov" => {
                    let mut moov = vec![0; (found.len - found.header) as usize];
                    file.seek(SeekFrom::Start(at + found.header)).map_err(io)?;
                    file.read_exact(&mut moov).map_err(io)?;
                    return Self::from_moov(&moov, file_len);
                }
                b"moof" => return Err("fragmented mp4 files are not read".into()),
                _ => at += found.len,
            }
        }
        Err("has no index (moov); is the file cut off or not an mp4?".into())
    }

    fn from_moov(moov: &[u8], file_len: u64) -> Result<Self> {
        let mut movie_scale = 0;
        let mut video = None;
        for child in Boxes(moov) {
            let (kind, body) = child?;
            match &kind {
                b"mvhd" => movie_scale = timescale(body)?,
                b"mvex" => return Err("fragmented mp4 files are not read".into()),
                b"trak" if video.is_none() => {
                    let media = required(body, b"mdia")?;
                    let handler = Fields(required(media, b"hdlr")?).skip(8)?.take(4)?.0;
                    if handler == b"vide" {
                        video = Some((body, media));
                    }
                }
                _ => {}
            }
        }
        let (track, media) = video.ok_or("has no video track")?;
        let scale = timescale(required(media, b"mdhd")?)?;
        let start = presentation_start(track, movie_scale, scale)?;
        let table = required(required(media, b"minf")?, b"stbl")?;
        let (width, height) = description(required(table, b"stsd")?)?;

        let places = sample_places(table, file_len)?;
        let times = sample_times(table, places.len(), scale)?;
        let mut samples: Vec<Mp4Sample> = places
            .into_iter()
            .zip(times)
            .map(|((offset, size), seconds)| Mp4Sample {
                offset,
                size,
                time: seconds + start,
                key: false,
            })
            .collect();
        if let Some(at) = samples.windows(2).position(|w| w[0].time >= w[1].time) {
            return Err(format!("frame {} is not shown after frame {at}", at + 1));
        }
        mark_keys(table, &mut samples)?;
        if !samples.first().is_some_and(|s| s.key) {
            return Err("does not begin with a key frame".into());
        }
        Ok(Self {
            width,
            height,
            samples,
        })
    }
}

/// Width and height of the first sample description, which has to be AV1.
fn description(stsd: &[u8]) -> Result<(usize, usize)> {
    let entries = Fields(stsd).skip(8)?.0;
    let (codec, entry) = Boxes(entries).next().ok_or("has no sample description")??;
    if &codec != b"av01" {
        return Err(format!(
            "video codec {:?}, only AV1 (av01) is read; re-encode the video",
            String::from_utf8_lossy(&codec)
        ));
    }
    let (mut fields, mut sides) = (Fields(entry).skip(24)?, [0; 2]);
    for side in &mut sides {
        *side = usize::from(fields.u16()?);
    }
    Ok((sides[0], sides[1]))
}

/// Offset and size of every sample: sizes (`stsz`), samples per chunk (`stsc`), chunk offsets (`stco`, `co64`).
fn sample_places(table: &[u8], file_len: u64) -> Result<Vec<(u64, u32)>> {
    let mut stsz = Fields(required(table, b"stsz")?).skip(4)?;
    let (uniform, count) = (stsz.u32()?, stsz.u32()? as usize);
    let claimed = if uniform == 0 {
        stsz.0.len() as u64 / 4
    } else {
        file_len / u64::from(uniform)
    };
    if count == 0 || count > MAX_SAMPLES || count as u64 > claimed {
        return Err(format!("frame count {count} does not fit the file"));
    }

    let (mut chunks, wide) = match (find(table, b"stco")?, find(table, b"co64")?) {
        (Some(body), _) => (Fields(body).skip(4)?, false),
        (None, Some(body)) => (Fields(body).skip(4)?, true),
        (None, None) => return Err("has no chunk offsets (stco)".into()),
    };
    let chunk_count = chunks.u32()?;
    let mut runs = Fields(required(table, b"stsc")?).skip(4)?;
    let run_count = runs.u32()? as usize;
    let runs: Vec<(u32, u32)> = (0..run_count.min(runs.0.len() / 12))
        .map(|_| Ok((runs.u32()?, runs.u32()?, runs.u32()?)))
        .map(|run: Result<(u32, u32, u32)>| run.map(|(first, per_chunk, _)| (first, per_chunk)))
        .collect::<Result<_>>()?;

    let mut places = Vec::with_capacity(count);
    let mut run = 0;
    for chunk in 1..=chunk_count {
        while runs.get(run + 1).is_some_and(|&(first, _)| first <= chunk) {
            run += 1;
        }
        let &(_, per_chunk) = runs.get(run).ok_or("has no sample-to-chunk table (stsc)")?;
        let mut at = if wide {
            chunks.u64()?
        } else {
            chunks.u32()?.into()
        };
        for _ in 0..per_chunk {
            if places.len() == count {
                break;
            }
            let size = if uniform == 0 { stsz.u32()? } else { uniform };
            let end = at
                .checked_add(size.into())
                .filter(|&end| end <= file_len && size > 0);
            let Some(end) = end else {
                return Err(format!(
                    "frame {} ({size} bytes from byte {at}) is not within the file's {file_len} bytes; is it cut off?",
                    places.len()
                ));
            };
            places.push((at, size));
            at = end;
        }
    }
    if places.len() != count {
        return Err(format!(
            "declares {count} frames and places {}",
            places.len()
        ));
    }
    Ok(places)
}

/// Second at which each sample is shown, before the edit list: durations (`stts`) and offsets (`ctts`).
fn sample_times(table: &[u8], count: usize, scale: u32) -> Result<Vec<f64>> {
    let mut times = Vec::with_capacity(count);
    let mut deltas = Runs::new(required(table, b"stts")?)?;
    let mut offsets = find(table, b"ctts")?.map(Runs::new).transpose()?;
    let mut decode_time: u64 = 0;
    for _ in 0..count {
        let offset = match &mut offsets {
            // Version 0 is unsigned, but never so large that the sign would matter.
            Some(offsets) => i64::from(offsets.next()? as i32),
            None => 0,
        };
        times.push((decode_time as f64 + offset as f64) / f64::from(scale));
        decode_time += u64::from(deltas.next()?);
    }
    Ok(times)
}

/// Marks the samples that `stss` lists; without it every sample is a key frame.
fn mark_keys(table: &[u8], samples: &mut [Mp4Sample]) -> Result<()> {
    let Some(stss) = find(table, b"stss")? else {
        samples.iter_mut().for_each(|s| s.key = true);
        return Ok(());
    };
    let mut numbers = Fields(stss).skip(4)?;
    for _ in 0..numbers.u32()? {
        let number = numbers.u32()? as usize;
        let sample = number.checked_sub(1).and_then(|i| samples.get_mut(i));
        sample
            .ok_or_else(|| format!("key frame {number} does not exist"))?
            .key = true;
    }
    Ok(())
}

/// Seconds that an edit list adds to all times: a blank at the start, or (negative) a part of the media that is skipped.
fn presentation_start(track: &[u8], movie_scale: u32, media_scale: u32) -> Result<f64> {
    let Some(edts) = find(track, b"edts")? else {
        return Ok(0.0);
    };
    let Some(elst) = find(edts, b"elst")? else {
        return Ok(0.0);
    };
    let mut fields = Fields(elst);
    let wide = fields.u32()? >> 24 == 1;
    let mut blank = 0.0;
    for _ in 0..fields.u32()? {
        let (duration, media_time) = if wide {
            (fields.u64()?, fields.u64()? as i64)
        } else {
            (fields.u32()?.into(), i64::from(fields.u32()? as i32))
        };
        fields.u32()?; // rate
        match media_time {
            -1 if movie_scale > 0 => blank += duration as f64 / f64::from(movie_scale),
            ticks if ticks >= 0 => return Ok(blank - ticks as f64 / f64::from(media_scale)),
            _ => return Err("has an edit list that is not understood".into()),
        }
    }
    Ok(blank)
}

/// The timescale of a movie or media header: ticks per second, at least 1.
fn timescale(header: &[u8]) -> Result<u32> {
    let mut fields = Fields(header);
    let wide = fields.u32()? >> 24 == 1;
    match fields.skip(if wide { 16 } else { 8 })?.u32()? {
        0 => Err("has a timescale of 0".into()),
        scale => Ok(scale),
    }
}

/// Run-length coded values: `count` pairs of (repetitions, value).
struct Runs<'a> {
    fields: Fields<'a>,
    left: u32,
    value: u32,
}

impl<'a> Runs<'a> {
    fn new(body: &'a [u8]) -> Result<Self> {
        Ok(Self {
            fields: Fields(body).skip(8)?,
            left: 0,
            value: 0,
        })
    }

    fn next(&mut self) -> Result<u32> {
        while self.left == 0 {
            self.left = self.fields.u32()?;
            self.value = self.fields.u32()?;
        }
        self.left -= 1;
        Ok(self.value)
    }
}

struct BoxHeader {
    kind: [u8; 4],
    /// Bytes of header.
    header: u64,
    /// Bytes of header and body, at most what was available.
    len: u64,
}

impl BoxHeader {
    fn parse(bytes: &[u8], available: u64) -> Result<Self> {
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

/// The boxes that follow one another in a byte string; ends after the first error.
struct Boxes<'a>(&'a [u8]);

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

fn find<'a>(parent: &'a [u8], kind: &[u8; 4]) -> Result<Option<&'a [u8]>> {
    for child in Boxes(parent) {
        let (found, body) = child?;
        if &found == kind {
            return Ok(Some(body));
        }
    }
    Ok(None)
}

fn required<'a>(parent: &'a [u8], kind: &[u8; 4]) -> Result<&'a [u8]> {
    find(parent, kind)?.ok_or_else(|| format!("has no {} box", String::from_utf8_lossy(kind)))
}

/// Big-endian fields from the front of a byte string.
struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    fn take(&mut self, n: usize) -> Result<Fields<'a>> {
        let (taken, rest) = self.0.split_at_checked(n).ok_or("a box ends too early")?;
        self.0 = rest;
        Ok(Fields(taken))
    }

    fn skip(mut self, n: usize) -> Result<Self> {
        self.take(n)?;
        Ok(self)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N]> {
        let mut bytes = [0; N];
        bytes.copy_from_slice(self.take(N)?.0);
        Ok(bytes)
    }

    fn u16(&mut self) -> Result<u16> {
        self.array().map(u16::from_be_bytes)
    }

    fn u32(&mut self) -> Result<u32> {
        self.array().map(u32::from_be_bytes)
    }

    fn u64(&mut self) -> Result<u64> {
        self.array().map(u64::from_be_bytes)
    }
}
