//! LeRobot's `delta_timestamps`: other frames around the current one, per feature, with flags for what is padding.

use std::collections::BTreeMap;

use zk0_lerobot::dataset::{Dataset, Frame, Info, Loader, Window};
use zk0_testkit::recordings::open;

const TOP: &str = "observation.images.top";
const STATE: &str = "observation.state";
const ACTION: &str = "action";

/// LeRobot's tolerance on timestamps, in seconds.
const TOLERANCE: f64 = 1e-4;
/// Most frames that one feature can be asked for at, and the furthest that one may be away.
const MAX_WINDOW: usize = 4096;

/// Seconds relative to the current frame, per feature: `observation.state`, `action`, or a camera.
///
/// Every offset has to be a multiple of `1 / fps`, within LeRobot's tolerance of 1e-4 s. Where a frame would lie outside the
/// episode its first or last one is given, and flagged as padding. A feature that is not named is given at the current frame.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct DeltaTimestamps(BTreeMap<String, Vec<f64>>);

impl DeltaTimestamps {
    /// Every feature at the current frame alone.
    pub fn new() -> Self {
        Self::default()
    }

    /// The same, with `feature` at these offsets.
    pub fn with(mut self, feature: impl Into<String>, seconds: impl Into<Vec<f64>>) -> Self {
        self.0.insert(feature.into(), seconds.into());
        self
    }

    /// The offsets in frames of a recording.
    pub fn window(&self, info: &Info) -> Result<Window, String> {
        let mut window = Window::now(info);
        for (key, seconds) in &self.0 {
            let wrong = |cause: String| format!("delta_timestamps of {key}: {cause}");
            let camera = info.cameras.iter().position(|c| &c.name == key);
            let place = match (key.as_str(), camera) {
                (STATE, _) => &mut window.state,
                (ACTION, _) => &mut window.action,
                (_, Some(camera)) => &mut window.cameras[camera],
                (_, None) => {
                    return Err(wrong(
                        "the recording has no camera, state or action of that name".into(),
                    ))
                }
            };
            if !(1..=MAX_WINDOW).contains(&seconds.len()) {
                return Err(wrong(format!(
                    "{} offsets given; it has to be 1 to {MAX_WINDOW}",
                    seconds.len()
                )));
            }
            *place = seconds
                .iter()
                .map(|&s| offset(s, info.fps).map_err(wrong))
                .collect::<Result<_, _>>()?;
        }
        Ok(window)
    }
}

/// The number of frames that `seconds` are.
fn offset(seconds: f64, fps: u32) -> Result<i64, String> {
    let fps = f64::from(fps);
    let frames = seconds * fps;
    let whole = frames.round();
    let fits = (frames - whole).abs() / fps <= TOLERANCE;
    // NaN is not above it.
    if !fits {
        return Err(format!(
            "{seconds} s is not a multiple of 1/{fps} s (within {TOLERANCE} s)"
        ));
    }
    if whole.abs() > MAX_WINDOW as f64 {
        return Err(format!("{seconds} s is more than {MAX_WINDOW} frames away"));
    }
    Ok(whole as i64)
}

fn loader_with<'a>(dataset: &'a Dataset, deltas: &DeltaTimestamps) -> Result<Loader<'a>, String> {
    Ok(Loader::new(dataset, deltas.window(dataset.info())?))
}

/// Returns these numbers of frames in seconds, at 30 frames a second.
fn seconds(frames: &[i32]) -> Vec<f64> {
    frames.iter().map(|&n| f64::from(n) / 30.0).collect()
}

fn now(dataset: &Dataset, index: usize) -> Frame {
    dataset.frame(index, 1).unwrap()
}

#[test]
fn every_feature_comes_from_the_frames_asked_for() {
    let dataset = open("so100_pickplace");
    let (past, around) = ([-5, -1, 0], [2, -3]);
    let deltas = DeltaTimestamps::new()
        .with(STATE, seconds(&past))
        .with("action", seconds(&[-1, 0, 1, 30]))
        .with(TOP, seconds(&around));
    let mut loader = loader_with(&dataset, &deltas).unwrap();
    // The episodes have 41 and 38 frames. The test reads the middle of the first, and both ends of the second.
    for (index, first, last) in [(20, 0, 40), (41, 41, 78), (43, 41, 78), (78, 41, 78)] {
        let frame = loader.frame(index).unwrap();
        let held = |offset: i32| {
            let wanted = index as i32 + offset;
            let held = wanted.clamp(first, last);
            (now(&dataset, held as usize), held != wanted)
        };
        let (states, is_pad): (Vec<_>, Vec<_>) = past.map(held).into_iter().unzip();
        assert_eq!(
            frame.state,
            states
                .iter()
                .flat_map(|f| f.state.clone())
                .collect::<Vec<_>>()
        );
        assert_eq!(frame.state_is_pad, is_pad, "{index}");
        let (actions, is_pad): (Vec<_>, Vec<_>) = [-1, 0, 1, 30].map(held).into_iter().unzip();
        assert_eq!(
            frame.actions,
            actions
                .iter()
                .flat_map(|f| f.actions.clone())
                .collect::<Vec<_>>()
        );
        assert_eq!(frame.action_is_pad, is_pad, "{index}");
        // The first camera is read at two times. The second camera is not named, so it is read at the current time.
        let pictures = around.map(held);
        assert_eq!(frame.images.len(), 3);
        for ((found, is_pad), (like, like_pad)) in
            frame.images.iter().zip(&frame.image_is_pad).zip(&pictures)
        {
            assert!(found == &like.images[0], "{index}");
            assert_eq!(is_pad, like_pad);
        }
        assert!(frame.images[2] == now(&dataset, index).images[1]);
        assert!(!frame.image_is_pad[2]);
        assert_eq!(
            (frame.index, frame.task.as_str()),
            (index, now(&dataset, index).task.as_str())
        );
        // Without pictures, the state and the actions are the same.
        let motion = loader.motion(index).unwrap();
        assert_eq!(
            (&motion.state, &motion.actions),
            (&frame.state, &frame.actions)
        );
    }
    let window = deltas.window(dataset.info()).unwrap();
    assert_eq!(window.cameras[0], [2, -3]);
    assert_eq!(window.cameras[1], [0]);
    assert_eq!(window.state, past.map(i64::from));
}

#[test]
fn a_chunk_of_actions_is_the_offsets_from_now_on() {
    let dataset = open("so100_sorting");
    let chunk: Vec<i32> = (0..50).collect();
    let deltas = DeltaTimestamps::new().with("action", seconds(&chunk));
    let mut loader = loader_with(&dataset, &deltas).unwrap();
    for index in [0, 39, 248] {
        assert!(loader.frame(index).unwrap() == dataset.frame(index, 50).unwrap());
    }
}

/// A window that slides over the recording gives the same pictures as one that is opened anew, even if it goes back.
#[test]
fn pictures_kept_from_the_last_frame_are_the_right_ones() {
    let dataset = open("so100_pickplace_v21");
    let deltas = DeltaTimestamps::new().with(TOP, seconds(&[-4, -2, 0, 0, 1]));
    let mut sliding = loader_with(&dataset, &deltas).unwrap();
    for index in (30..50).chain([44, 43, 200, 42]) {
        let anew = loader_with(&dataset, &deltas)
            .unwrap()
            .frame(index)
            .unwrap();
        assert!(sliding.frame(index).unwrap() == anew, "{index}");
    }
}

#[test]
fn offsets_that_are_no_frames_are_refused() {
    let dataset = open("so100_pickplace");
    let refused = |deltas: DeltaTimestamps| match loader_with(&dataset, &deltas) {
        Ok(_) => panic!("taken"),
        Err(cause) => cause,
    };
    let action = |seconds: Vec<f64>| refused(DeltaTimestamps::new().with("action", seconds));
    // LeRobot's tolerance is 1e-4 s.
    assert_eq!(
        action(vec![0.0, 0.0335]),
        "delta_timestamps of action: 0.0335 s is not a multiple of 1/30 s (within 0.0001 s)"
    );
    let near = DeltaTimestamps::new().with("action", [0.0334]);
    assert_eq!(near.window(dataset.info()).unwrap().action, [1]);
    assert!(action(vec![f64::NAN]).contains("not a multiple"));
    assert!(action(vec![f64::INFINITY]).contains("not a multiple"));
    assert!(action(vec![1e6]).contains("more than 4096 frames away"));
    assert!(action(vec![]).contains("0 offsets given"));
    assert!(action(vec![0.0; 4097]).contains("4097 offsets given"));
    assert!(
        refused(DeltaTimestamps::new().with("observation.images.left", [0.0]))
            .contains("observation.images.left: the recording has no camera")
    );
}
