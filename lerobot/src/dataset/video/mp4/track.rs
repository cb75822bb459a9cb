//! An mp4's first video track.

use std::io::{Read, Seek, SeekFrom};

use super::boxes::{find, required, BoxHeader, Boxes, Fields, Result};
use super::nal_config::NalConfig;
use super::sample::{ContainerColors, Mp4Codec, Mp4Sample};
use super::tables;
use super::turn::Rotation;

/// Largest `moov` box read; a million frames take about 10 MB.
const MAX_MOOV: u64 = 64 << 20;

/// An mp4's first video track.
#[derive(Debug, Clone, PartialEq)]
pub struct Mp4Track {
    /// Declared pixels from left to right.
    pub width: usize,
    /// Pixels from top to bottom.
    pub height: usize,
    /// Codec of the frames.
    pub codec: Mp4Codec,
    /// The container's colours.
    pub colors: ContainerColors,
    /// How to turn the frames; width and height are before the turn.
    pub turn: Rotation,
    /// Frames in decoding order.
    pub samples: Vec<Mp4Sample>,
    /// Sample numbers in order of presentation; for AV1 that of decoding.
    pub order: Vec<u32>,
}

impl Mp4Track {
    /// Reads the track of an unfragmented mp4 with AV1, H.264 or HEVC video.
    ///
    /// # Errors
    /// What is wrong with the file.
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
                b"mvhd" => {
                    movie_scale = timescale(body)?;
                    Rotation::refuse_in_movie(body)?;
                }
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
        let (width, height, codec, colors) = description(required(table, b"stsd")?)?;
        let turn = find(track, b"tkhd")?.map_or(Ok(Rotation::None), Rotation::of_track)?;

        let places = tables::sample_places(table, file_len)?;
        let times = tables::sample_times(table, places.len(), scale)?;
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
        let order = order_of_presentation(&codec, &samples)?;
        tables::mark_keys(table, &mut samples)?;
        if !samples.first().is_some_and(|s| s.key) {
            return Err("does not begin with a key frame".into());
        }
        Ok(Self {
            width,
            height,
            codec,
            colors,
            turn,
            samples,
            order,
        })
    }
}

/// Samples by time of presentation; AV1 must be shown as decoded, no two at once.
fn order_of_presentation(codec: &Mp4Codec, samples: &[Mp4Sample]) -> Result<Vec<u32>> {
    let mut order: Vec<u32> = (0..samples.len() as u32).collect();
    let time = |sample: u32| samples[sample as usize].time;
    if *codec != Mp4Codec::Av1 {
        order.sort_by(|&a, &b| time(a).total_cmp(&time(b)));
    }
    match order.windows(2).find(|w| time(w[0]) >= time(w[1])) {
        Some(pair) => Err(format!(
            "frame {} is not shown after frame {}",
            pair[1], pair[0]
        )),
        None => Ok(order),
    }
}

/// Width, height, codec and colours of the first sample description.
fn description(stsd: &[u8]) -> Result<(usize, usize, Mp4Codec, ContainerColors)> {
    let entries = Fields(stsd).skip(8)?.0;
    let (kind, entry) = Boxes(entries).next().ok_or("has no sample description")??;
    let (mut fields, mut sides) = (Fields(entry).skip(24)?, [0; 2]);
    for side in &mut sides {
        *side = usize::from(fields.u16()?);
    }
    // The entry's fields take 78 bytes.
    let boxes = entry.get(78..).ok_or("a box ends too early")?;
    let codec = match &kind {
        b"av01" => Mp4Codec::Av1,
        b"avc1" | b"avc3" => Mp4Codec::H264(NalConfig::avc(required(boxes, b"avcC")?)?),
        b"hvc1" | b"hev1" => Mp4Codec::Hevc(NalConfig::hevc(required(boxes, b"hvcC")?)?),
        _ => {
            return Err(format!(
                "video codec {:?}, only AV1 (av01), H.264 (avc1) and HEVC (hvc1, hev1) are read; re-encode the video",
                String::from_utf8_lossy(&kind)
            ))
        }
    };
    let colors = find(boxes, b"colr")?.map_or(Ok(ContainerColors::default()), stated_colors)?;
    Ok((sides[0], sides[1], codec, colors))
}

/// A `colr` box: matrix, and in the newer kind the range; other kinds hold a profile.
fn stated_colors(colr: &[u8]) -> Result<ContainerColors> {
    let mut fields = Fields(colr);
    let kind = fields.take(4)?.0;
    if kind != b"nclx" && kind != b"nclc" {
        return Ok(ContainerColors::default());
    }
    fields.take(4)?; // primaries, transfer
    let matrix = fields.u16()?;
    let full_range = match kind {
        b"nclx" => Some(fields.u8()? >> 7 == 1),
        _ => None,
    };
    Ok(ContainerColors {
        matrix: Some(matrix.into()),
        full_range,
    })
}

/// Seconds that an edit list adds to all times: a blank first, or (negative) a skipped part.
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

/// A header's timescale: ticks per second, at least 1.
fn timescale(header: &[u8]) -> Result<u32> {
    let mut fields = Fields(header);
    let wide = fields.u32()? >> 24 == 1;
    match fields.skip(if wide { 16 } else { 8 })?.u32()? {
        0 => Err("has a timescale of 0".into()),
        scale => Ok(scale),
    }
}
