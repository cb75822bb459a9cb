//! A track's sample table: where each frame is, when it is shown, where decoding can start.

use crate::dataset::video::mp4::boxes::{find, required, Fields, Result};
use crate::dataset::video::mp4::sample::Mp4Sample;

const MAX_SAMPLES: usize = 10_000_000;

/// Every sample's offset and size: sizes (`stsz`), samples per chunk (`stsc`), chunk offsets (`stco`, `co64`).
pub(crate) fn sample_places(table: &[u8], file_len: u64) -> Result<Vec<(u64, u32)>> {
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

/// Second of each sample before the edit list: durations (`stts`) and offsets (`ctts`).
pub(crate) fn sample_times(table: &[u8], count: usize, scale: u32) -> Result<Vec<f64>> {
    let mut times = Vec::with_capacity(count);
    let mut deltas = RunLengths::new(required(table, b"stts")?)?;
    let mut offsets = find(table, b"ctts")?.map(RunLengths::new).transpose()?;
    let mut decode_time: u64 = 0;
    for _ in 0..count {
        let offset = match &mut offsets {
            // Version 0 is unsigned, but never large enough to matter.
            Some(offsets) => i64::from(offsets.next()? as i32),
            None => 0,
        };
        times.push((decode_time as f64 + offset as f64) / f64::from(scale));
        decode_time += u64::from(deltas.next()?);
    }
    Ok(times)
}

/// Marks the samples in `stss`; without it, all are key frames.
pub(crate) fn mark_keys(table: &[u8], samples: &mut [Mp4Sample]) -> Result<()> {
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

/// Run lengths: `count` pairs of (repetitions, value).
struct RunLengths<'a> {
    fields: Fields<'a>,
    left: u32,
    value: u32,
}

impl<'a> RunLengths<'a> {
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
