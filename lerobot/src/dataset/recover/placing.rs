//! Which stretch of a camera's videos belongs to which episode.
//!
//! LeRobot appends whole episodes' videos in order, and begins a new file before one becomes too large. So the numbers of frames tell where
//! episodes begin.

/// A video's frames in order of presentation: each one's second, and whether decoding can start there.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct VideoFrames {
    pub times: Vec<f64>,
    pub keys: Vec<bool>,
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Stretch {
    /// Which of the camera's videos.
    pub video: usize,
    /// Seconds at which it begins and ends.
    pub from: f64,
    pub to: f64,
}

#[derive(Debug, Default, PartialEq)]
pub(crate) struct Placing {
    /// For the first episodes, in order; the others have no pictures here.
    pub stretches: Vec<Stretch>,
    /// Pictures after all episodes, at the last video's end.
    pub surplus: usize,
    /// Why the other episodes cannot be placed, where videos and rows do not fit.
    pub fault: Option<Misfit>,
}

/// A video whose pictures do not fit its episodes' rows.
#[derive(Debug, PartialEq)]
pub(crate) struct Misfit {
    /// Which of the camera's videos.
    pub video: usize,
    pub pictures: usize,
}

impl VideoFrames {
    /// Frames `first..first + count` of video number `video`.
    pub fn stretch(&self, video: usize, first: usize, count: usize, fps: u32) -> Stretch {
        let second = 1.0 / f64::from(fps);
        let from = self.times.get(first).copied().unwrap_or(0.0);
        let last = self.times.get(first + count - 1).copied();
        let next = self.times.get(first + count).copied();
        let to = next.or(last.map(|last| last + second)).unwrap_or(from);
        Stretch { video, from, to }
    }

    /// Whether frames `first..first + count` begin with a key frame and are `1 / fps` apart, as in one episode.
    fn are_an_episode(&self, first: usize, count: usize, fps: u32) -> bool {
        let times = &self.times[first..first + count];
        self.keys[first]
            && times.iter().enumerate().all(|(i, time)| {
                let due = times[0] + i as f64 / f64::from(fps);
                (time - due).abs() < 0.5 / f64::from(fps)
            })
    }
}

/// Places episodes of `lengths` frames in one camera's videos. If `exactly`, pictures after the last episode are a misfit.
pub(crate) fn place(lengths: &[usize], videos: &[VideoFrames], fps: u32, exactly: bool) -> Placing {
    let mut placing = Placing::default();
    let mut lengths = lengths.iter().copied().peekable();
    for (video, frames) in videos.iter().enumerate() {
        let (start, pictures) = (placing.stretches.len(), frames.times.len());
        let (mut at, mut fits) = (0, true);
        while let Some(length) = lengths.next_if(|&length| length <= pictures - at) {
            fits &= frames.are_an_episode(at, length, fps);
            let stretch = frames.stretch(video, at, length, fps);
            placing.stretches.push(stretch);
            at += length;
        }
        let may_be_more = lengths.peek().is_none() && !exactly;
        // A video holds whole episodes. If not, pictures are missing, and nothing tells from which episode.
        if !fits || (at < pictures && !may_be_more) {
            placing.stretches.truncate(start);
            placing.fault = Some(Misfit { video, pictures });
            return placing;
        }
        placing.surplus += pictures - at;
    }
    placing
}

#[cfg(test)]
mod tests {
    use super::*;

    fn video(frames: usize) -> VideoFrames {
        VideoFrames {
            times: (0..frames).map(|i| i as f64 / 10.0).collect(),
            keys: (0..frames).map(|i| i % 2 == 0).collect(),
        }
    }

    fn placed(lengths: &[usize], videos: &[usize]) -> Placing {
        let videos: Vec<_> = videos.iter().map(|&frames| video(frames)).collect();
        place(lengths, &videos, 10, false)
    }

    #[test]
    fn episodes_fill_the_videos_in_order() {
        let placing = placed(&[4, 2, 6, 5], &[6, 6]);
        let found: Vec<_> = placing
            .stretches
            .iter()
            .map(|s| (s.video, (s.from * 10.0).round(), (s.to * 10.0).round()))
            .collect();
        // The last episode's pictures were not encoded.
        assert_eq!(found, [(0, 0.0, 4.0), (0, 4.0, 6.0), (1, 0.0, 6.0)]);
        assert_eq!((placing.surplus, placing.fault), (0, None));
        assert_eq!(placed(&[4], &[7]).surplus, 3);
        let exactly = place(&[4, 4], &[video(4), video(7)], 10, true);
        let fault = Misfit {
            video: 1,
            pictures: 7,
        };
        assert_eq!((exactly.stretches.len(), exactly.fault), (1, Some(fault)));
    }

    #[test]
    fn a_video_with_too_few_pictures_places_none_of_its_episodes() {
        let placing = placed(&[4, 2, 6, 2], &[6, 5, 2]);
        assert_eq!(placing.stretches.len(), 2);
        let fault = Misfit {
            video: 1,
            pictures: 5,
        };
        assert_eq!(placing.fault, Some(fault));
        // The numbers fit, but the second episode would begin without a key frame.
        let fault = Misfit {
            video: 0,
            pictures: 5,
        };
        assert_eq!(placed(&[3, 2], &[5]).fault, Some(fault));
    }

    #[test]
    fn pictures_that_are_not_one_frame_apart_are_no_episode() {
        let mut gap = video(4);
        gap.times[3] += 0.1;
        let fault = Misfit {
            video: 0,
            pictures: 4,
        };
        assert_eq!(place(&[4], &[gap], 10, false).fault, Some(fault));
    }
}
