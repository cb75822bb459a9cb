//! Which frames FFmpeg gets, and which pictures it returns: frames in decoding order from a key frame on, pictures in presentation order.

use std::collections::BTreeMap;

use super::process::Process;
use crate::dataset::video::picture_order::PicturePosition;
use crate::dataset::video::restart::Restart;

/// Most frames between the two orders.
const MAX_SHIFT: usize = 64;

pub(crate) struct Player {
    process: Process,
    restart: Restart,
    /// Samples in order of presentation.
    order: Vec<u32>,
    /// FFmpeg has everything from the key frame to before this sample, except what does not decode from there.
    next: usize,
    /// The next picture is of the first given sample from here on, in presentation.
    number: usize,
    given: usize,
    /// Samples without a picture yet, with their places in the stream.
    awaited: BTreeMap<usize, Option<PicturePosition>>,
}

impl Player {
    /// Begins at a key frame. `order` has the samples in presentation.
    pub fn start(
        demuxer: &str,
        picture_bytes: usize,
        order: &[u32],
        restart: Restart,
    ) -> Result<Self, String> {
        let far = |(number, at): (usize, &u32)| number.abs_diff(*at as usize) > MAX_SHIFT;
        if order.iter().enumerate().any(far) {
            return Err(
                "is in a file whose frames are shown in an order far from that of decoding".into(),
            );
        }
        Ok(Self {
            process: Process::start(demuxer, picture_bytes)?,
            order: order.into(),
            next: restart.key,
            number: restart.key.saturating_sub(MAX_SHIFT),
            given: 0,
            awaited: BTreeMap::new(),
            restart,
        })
    }

    /// Number of the next picture in presentation, or of all frames.
    pub fn next_number(&self) -> usize {
        let plays = |sample: u32| {
            let sample = sample as usize;
            sample >= self.restart.key && !self.restart.skipped.contains(&sample)
        };
        let rest = self.order.iter().skip(self.number);
        self.number + rest.take_while(|sample| !plays(**sample)).count()
    }

    /// The planes of frame `number`, not before [`Player::next_number`]. `sample` gives a sample's byte stream, with parameter sets first
    /// if the flag is set, and its picture's place in the stream, if known.
    pub fn picture(
        &mut self,
        number: usize,
        mut sample: impl FnMut(usize, bool) -> Result<(Vec<u8>, Option<PicturePosition>), String>,
    ) -> Result<Vec<u8>, String> {
        loop {
            let at = self.next_number();
            if at > number {
                return Err("refers to frames that the file does not have".into());
            }
            let picture = self.next_picture(&mut sample)?;
            let planes = picture.ok_or_else(|| self.count_fault())?;
            self.given += 1;
            self.number = at + 1;
            self.refuse_other_order(at)?;
            // At the end, no picture may be left over.
            if self.next_number() == self.order.len() && self.next_picture(&mut sample)?.is_some() {
                self.given += 1;
                return Err(self.count_fault());
            }
            if at == number {
                return Ok(planes);
            }
        }
    }

    /// Fails unless the picture is of frame `at`: the first in the stream that is still missing.
    fn refuse_other_order(&mut self, at: usize) -> Result<(), String> {
        let place = self.awaited.remove(&(self.order[at] as usize));
        let first = self.awaited.values().flatten().min().copied();
        match place {
            Some(None) => Ok(()),
            Some(place) if first.is_none() || place < first => Ok(()),
            _ => Err(
                "is shown at another time by the file (ctts) than by the stream in it, and nothing tells which is right; LeRobot goes by the \
                 file; encode the video anew"
                    .into(),
            ),
        }
    }

    fn next_picture(
        &mut self,
        sample: &mut impl FnMut(usize, bool) -> Result<(Vec<u8>, Option<PicturePosition>), String>,
    ) -> Result<Option<Vec<u8>>, String> {
        let (next, frames) = (&mut self.next, self.order.len());
        let Restart { key, skipped } = &self.restart;
        let awaited = &mut self.awaited;
        self.process.picture(|| {
            while skipped.contains(next) {
                *next += 1;
            }
            if *next == frames {
                return Ok(None);
            }
            let (bytes, place) = sample(*next, *next == *key)?;
            awaited.insert(*next, place);
            *next += 1;
            Ok(Some(bytes))
        })
    }

    fn count_fault(&self) -> String {
        let expected = self.order.len() - self.restart.key - self.restart.skipped.len();
        let given = self.given;
        let more = if given > expected { "or more " } else { "" };
        format!(
            "has no picture of its own: FFmpeg makes {given} {more}pictures of {expected} frames"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn an_order_that_no_film_has_is_refused() {
        let start = |order: &[u32]| {
            let restart = Restart {
                key: 0,
                skipped: BTreeSet::new(),
            };
            Player::start("hevc", 64, order, restart).map(drop)
        };
        let backwards: Vec<u32> = (0..80).rev().collect();
        assert!(start(&backwards)
            .unwrap_err()
            .contains("far from that of decoding"));
        assert_eq!(start(&[0, 2, 1]), Ok(()));
    }

    #[test]
    fn a_picture_that_is_not_played_is_refused() {
        // The first picture is shown before the key frame and refers to earlier ones.
        let restart = Restart {
            key: 0,
            skipped: BTreeSet::from([1]),
        };
        let mut player = Player::start("hevc", 64, &[1, 0], restart).unwrap();
        let error = player.picture(0, |_, _| Err("was asked for".into()));
        assert_eq!(
            error.unwrap_err(),
            "refers to frames that the file does not have"
        );
    }
}
