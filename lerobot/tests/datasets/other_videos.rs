//! Videos as cameras, GPUs and editors write them: their pictures are those of LeRobot 0.6.1, level by level.
//!
//! `tests/fixtures/videos_other/make.py` made them with PyAV 15.1 and FFmpeg 5.1, and read them with LeRobot. HEVC and parts of H.264
//! take an installed FFmpeg here; without it these tests fail.

use std::fs;
use std::ops::Range;
use std::path::PathBuf;

use zk0_lerobot::dataset::{Mp4Codec, Mp4Track, VideoReader};
use zk0_testkit::own_process::{alone, is_alone};
use zk0_testkit::recordings::{fixtures, patch};

const HEIGHT: usize = 48;
const WIDTH: usize = 64;
const FRAMES: usize = 12;
/// The frames whose pixels are kept.
const KEPT: [usize; 4] = [0, 4, 7, 11];

/// Videos that this program decodes itself.
const IN_PROCESS: [&str; 12] = [
    "h264_plain",
    "h264_bt709",
    "h264_bt2020",
    "h264_full",
    "h264_bt709_full",
    "h264_container_colors",
    "av1_bt709",
    "av1_full",
    "av1_10bit",
    "av1_12bit",
    "av1_422",
    "av1_444",
];

/// Videos that FFmpeg decodes.
const BY_FFMPEG: [&str; 22] = [
    "h264_lossless",
    "h264_422",
    "h264_444",
    "h264_10bit",
    "h264_10bit_slices",
    "h264_422_10bit",
    "h264_interlaced",
    "h264_444_full",
    "h264_10bit_full",
    "hevc_hev1",
    "hevc_hvc1",
    "hevc_bt709",
    "hevc_full",
    "hevc_10bit",
    "hevc_10bit_full",
    "hevc_12bit",
    "hevc_422_10bit",
    "hevc_422_full",
    "hevc_444",
    "hevc_444_12bit",
    "hevc_like_nvenc",
    "hevc_checksums",
];

fn file(name: &str) -> PathBuf {
    fixtures().join(format!("videos_other/{name}.mp4"))
}

/// LeRobot's pixels of the frames in `KEPT`.
fn likes(name: &str) -> Vec<Vec<u8>> {
    let path = fixtures().join(format!("videos_other/{name}.rgb"));
    let bytes = fs::read(path).unwrap();
    let pictures = bytes.chunks_exact(3 * HEIGHT * WIDTH);
    pictures.map(<[u8]>::to_vec).collect()
}

/// All frames in order.
fn forwards(name: &str, height: usize, width: usize) -> (VideoReader, Vec<Vec<u8>>) {
    let mut video = VideoReader::open(&file(name), height, width).unwrap();
    assert_eq!(video.len(), FRAMES, "{name}");
    let frames = (0..FRAMES).map(|n| {
        assert_eq!(video.frame_at(n as f64 / 30.0, 1e-4).unwrap(), n, "{name}");
        video.rgb(n).unwrap_or_else(|e| panic!("{name}: {e}"))
    });
    let frames = frames.collect();
    (video, frames)
}

fn same_as_lerobot(name: &str, height: usize, width: usize) {
    let (mut video, frames) = forwards(name, height, width);
    for (n, like) in KEPT.iter().zip(likes(name)) {
        let furthest = frames[*n].iter().zip(&like).map(|(a, b)| a.abs_diff(*b));
        assert_eq!(furthest.max(), Some(0), "{name} frame {n}");
    }
    // Backwards and in leaps, decoding begins at key frames.
    for n in [11, 8, 9, 3, 0, 5, 4, 10, 10, 1, 7] {
        let frame = video.rgb(n).unwrap_or_else(|e| panic!("{name} {n}: {e}"));
        assert!(frame == frames[n], "{name} frame {n} out of order");
    }
}

#[test]
fn what_this_program_decodes_is_what_lerobot_reads() {
    for name in IN_PROCESS.iter().chain(&["av1_444_10bit"]) {
        same_as_lerobot(name, HEIGHT, WIDTH);
    }
}

#[test]
fn what_ffmpeg_decodes_is_what_lerobot_reads() {
    for name in BY_FFMPEG.iter().chain(&["hevc_like_videotoolbox"]) {
        same_as_lerobot(name, HEIGHT, WIDTH);
    }
}

#[test]
fn a_picture_is_turned_as_the_container_states() {
    same_as_lerobot("h264_turned_180", HEIGHT, WIDTH);
    same_as_lerobot("h264_turned_90", WIDTH, HEIGHT);
    same_as_lerobot("h264_turned_270", WIDTH, HEIGHT);
}

fn failure(mp4: &[u8], height: usize, width: usize) -> String {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("video.mp4");
    fs::write(&path, mp4).unwrap();
    let read = VideoReader::open(&path, height, width)
        .and_then(|mut video| (0..video.len()).try_for_each(|n| video.rgb(n).map(drop)));
    let message = read.expect_err("nothing was wrong").to_string();
    assert!(message.contains("video.mp4: "), "{message}");
    message
}

fn bytes(name: &str) -> Vec<u8> {
    fs::read(file(name)).unwrap()
}

/// Offset and size of every sample.
fn samples(name: &str) -> Vec<(usize, usize)> {
    let track = Mp4Track::read(&mut fs::File::open(file(name)).unwrap()).unwrap();
    let samples = track.samples.iter();
    samples
        .map(|s| (s.offset as usize, s.size as usize))
        .collect()
}

#[test]
fn a_turn_that_the_shape_contradicts_is_named() {
    let message = failure(&bytes("h264_turned_90"), HEIGHT, WIDTH);
    assert!(
        message.contains("64 x 48 (height x width) after the turn that the file states (tkhd)"),
        "{message}"
    );
    // A mirror, which LeRobot takes for a half turn, and a turn of the whole movie.
    let mut other = bytes("h264_plain");
    patch(&mut other, b"tkhd", 0, 40, &[0xff, 0xff]);
    assert!(failure(&other, HEIGHT, WIDTH).contains("(tkhd), and only turns by quarters"));
    let mut other = bytes("h264_plain");
    patch(&mut other, b"mvhd", 0, 36, &[0xff, 0xff]);
    assert!(failure(&other, HEIGHT, WIDTH).contains("turns the whole movie (mvhd)"));
}

#[test]
fn pictures_that_ffmpeg_would_make_up_are_refused() {
    // By itself, FFmpeg gives twelve pictures of each of these files, and ends with 0. Of the second one it logs nothing.
    let cases: [(&str, usize, fn(usize) -> Range<usize>, u8); 4] = [
        ("h264_lossless", 0, |size| size * 2 / 3..size, 0x5a),
        ("hevc_hvc1", 0, |_| 7..12, 0xff),
        ("hevc_10bit", 0, |_| 7..12, 0xff),
        ("hevc_hvc1", 1, |size| size / 2..size, 0xff),
    ];
    for (name, sample, noise, value) in cases {
        let (at, size) = samples(name)[sample];
        let mut other = bytes(name);
        other[at..at + size][noise(size)].fill(value);
        let message = failure(&other, HEIGHT, WIDTH);
        assert!(message.contains("does not decode"), "{name}: {message}");
        assert!(message.contains("FFmpeg"), "{name}: {message}");
    }
    // The second sample becomes a unit that holds no picture, and one that belongs to another layer.
    let (at, _) = samples("hevc_hvc1")[1];
    let mut missing = bytes("hevc_hvc1");
    missing[at + 4] = 38 << 1;
    let message = failure(&missing, HEIGHT, WIDTH);
    assert!(
        message.contains("sample 1 does not hold one picture"),
        "{message}"
    );
    // The second of three slices is gone. FFmpeg fills it in, and logs nothing unless it is to end there (`-xerror`).
    let mp4 = with_second_sample("h264_10bit_slices", |sample| {
        let len =
            |at: usize| 4 + u32::from_be_bytes(sample[at..at + 4].try_into().unwrap()) as usize;
        let (first, second) = (len(0), len(len(0)));
        sample.drain(first..first + second);
    });
    assert!(failure(&mp4, HEIGHT, WIDTH).contains("corrupt decoded frame"));
    let mut layered = bytes("hevc_hvc1");
    layered[at + 5] |= 8;
    assert!(failure(&layered, HEIGHT, WIDTH).contains("several layers"));
}

/// By itself, FFmpeg gives twelve pictures of each of these files, and ends with 0.
#[test]
fn the_checksum_of_a_picture_is_compared() {
    let name = "hevc_checksums";
    for (at, size) in [2, 4, 6, 8].map(|sample| samples(name)[sample]) {
        for part in 1..4 {
            let mut other = bytes(name);
            other[at + size * part / 5] ^= 0x10;
            let message = failure(&other, HEIGHT, WIDTH);
            assert!(message.contains("does not decode"), "{message}");
        }
    }
}

/// Exchanges the times (`ctts`) of two frames.
fn exchanged(name: &str, offsets: [(usize, i32); 2]) -> Vec<u8> {
    let mut other = bytes(name);
    for (entry, offset) in offsets {
        patch(
            &mut other,
            b"ctts",
            0,
            8 + 8 * entry + 4,
            &offset.to_be_bytes(),
        );
    }
    other
}

/// LeRobot goes by the file, and so does what this program decodes itself. FFmpeg sees the stream alone.
#[test]
fn a_file_that_contradicts_the_order_of_its_stream() {
    let of_h264 = [(1, 4608), (4, -512)];
    for (name, offsets) in [("hevc_hev1", [(7, 512), (8, 512)]), ("h264_10bit", of_h264)] {
        let message = failure(&exchanged(name, offsets), HEIGHT, WIDTH);
        let cause = "is shown at another time by the file (ctts) than by the stream in it";
        assert!(message.contains(cause), "{name}: {message}");
    }
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("video.mp4");
    fs::write(&path, exchanged("h264_plain", of_h264)).unwrap();
    let mut video = VideoReader::open(&path, HEIGHT, WIDTH).unwrap();
    let (_, frames) = forwards("h264_plain", HEIGHT, WIDTH);
    for (frame, shown) in [(2, 2), (3, 8), (4, 4), (8, 3), (9, 9)] {
        assert!(video.rgb(frame).unwrap() == frames[shown], "{frame}");
    }
}

#[test]
fn lossless_h264_is_not_decoded_as_if_it_had_loss() {
    // OpenH264 gives pictures of this stream, and all are wrong.
    let (_, frames) = forwards("h264_lossless", HEIGHT, WIDTH);
    assert!(frames[0] == likes("h264_lossless")[0]);
}

#[test]
fn a_parameter_set_within_may_not_change_what_the_first_one_declares() {
    let track = Mp4Track::read(&mut fs::File::open(file("h264_lossless")).unwrap()).unwrap();
    let Mp4Codec::H264(config) = track.codec else {
        panic!()
    };
    let set = &config.parameter_sets[0];
    // The first unit of the file is a remark of x264's. Its beginning becomes the other parameter set.
    let (at, _) = samples("h264_plain")[0];
    let mut other = bytes("h264_plain");
    assert_eq!(other[at + 4] & 0x1f, 6);
    let len = u32::from_be_bytes(other[at..at + 4].try_into().unwrap()) as usize;
    let (unit, rest) = other[at..at + 4 + len].split_at_mut(4 + set.len());
    unit[..4].copy_from_slice(&(set.len() as u32).to_be_bytes());
    unit[4..].copy_from_slice(set);
    let left = rest.len() as u32 - 4;
    rest[..4].copy_from_slice(&left.to_be_bytes());
    rest[4] = 6;
    assert!(failure(&other, HEIGHT, WIDTH).contains("has other pictures"));
}

/// The first parameter set of a video that declares pictures.
fn sequence_set(name: &str) -> Vec<u8> {
    let track = Mp4Track::read(&mut fs::File::open(file(name)).unwrap()).unwrap();
    let (config, is_set): (_, fn(u8) -> bool) = match track.codec {
        Mp4Codec::H264(config) => (config, |head| head & 0x1f == 7),
        Mp4Codec::Hevc(config) => (config, |head| head >> 1 == 33),
        Mp4Codec::Av1 => panic!(),
    };
    let mut sets = config.parameter_sets.into_iter();
    sets.find(|set| is_set(set[0])).unwrap()
}

/// The video with the second sample changed. All samples lie behind the old ones.
fn with_second_sample(name: &str, change: impl Fn(&mut Vec<u8>)) -> Vec<u8> {
    let mut mp4 = bytes(name);
    let places = samples(name);
    let mut all: Vec<Vec<u8>> = places
        .iter()
        .map(|(at, n)| mp4[*at..at + n].to_vec())
        .collect();
    change(&mut all[1]);
    let first = mp4.len() as u32 + 8;
    let size = all[1].len() as u32;
    patch(&mut mp4, b"stco", 0, 8, &first.to_be_bytes());
    patch(&mut mp4, b"stsz", 0, 12 + 4, &size.to_be_bytes());
    let content = all.concat();
    mp4.extend((content.len() as u32 + 8).to_be_bytes());
    mp4.extend(b"mdat");
    mp4.extend(content);
    mp4
}

#[test]
fn samples_for_ffmpeg_are_checked_one_by_one() {
    for (name, other) in [("hevc_hev1", "hevc_10bit"), ("h264_444", "h264_lossless")] {
        let set = sequence_set(other);
        let mp4 = with_second_sample(name, |sample| {
            let len = (set.len() as u32).to_be_bytes();
            *sample = [&len, &set[..], sample].concat();
        });
        let message = failure(&mp4, HEIGHT, WIDTH);
        assert!(message.contains("sample 1 has other pictures"), "{message}");
    }
    // A remark takes the place of the picture.
    let mp4 = with_second_sample("h264_444", |sample| sample[4] = 6);
    let message = failure(&mp4, HEIGHT, WIDTH);
    assert!(
        message.contains("sample 1 does not hold one picture"),
        "{message}"
    );
}

#[test]
fn a_time_at_which_no_frame_is_shown_is_named() {
    let video = VideoReader::open(&file("h264_plain"), HEIGHT, WIDTH).unwrap();
    for seconds in [-1.0, 0.5 / 30.0, 12.0 / 30.0] {
        let message = video.frame_at(seconds, 1e-4).unwrap_err().to_string();
        assert!(
            message.contains("its 12 frames end at 0.366667 s"),
            "{message}"
        );
    }
}

#[test]
fn av1_in_other_colours_is_refused() {
    assert!(failure(&bytes("av1_gray"), HEIGHT, WIDTH).contains("has no colours"));
    // Primaries, transfer and matrix of BT.709 are 1, 1 and 1, somewhere in the bits of the first header. The matrix becomes YCgCo.
    let mut other = bytes("av1_bt709");
    let (at, _) = samples("av1_bt709")[0];
    let head = &mut other[at..at + 24];
    let bit = |head: &[u8], at: usize| head[at / 8] >> (7 - at % 8) & 1;
    let byte = |head: &[u8], at: usize| (0..8).fold(0, |byte, i| byte << 1 | bit(head, at + i));
    let found: Vec<usize> = (0..24 * 8 - 24)
        .filter(|&at| (0..3).all(|i| byte(head, at + 8 * i) == 1))
        .collect();
    let [colors] = found[..] else {
        panic!("{found:?}")
    };
    for (last, value) in [(4, 1), (7, 0)] {
        let at = colors + 16 + last;
        head[at / 8] = head[at / 8] & !(128 >> (at % 8)) | value << (7 - at % 8);
    }
    assert_eq!(byte(head, colors + 16), 8);
    let message = failure(&other, HEIGHT, WIDTH);
    assert!(
        message.contains("matrix; BT.601, BT.709 and BT.2020 are read"),
        "{message}"
    );
}

#[test]
fn ffmpeg_writes_no_report() {
    let dir = tempfile::tempdir().unwrap();
    let report = dir.path().join("report");
    if !is_alone() {
        let variable = format!("FFREPORT=file={}:level=32", report.display());
        alone(
            "datasets::other_videos::ffmpeg_writes_no_report",
            &["env", &variable],
        );
        assert!(!report.exists());
        return;
    }
    let mut video = VideoReader::open(&file("hevc_hev1"), HEIGHT, WIDTH).unwrap();
    video.rgb(0).unwrap();
}

#[test]
fn more_pictures_than_frames_are_refused() {
    // The eleventh frame takes in the twelfth, and the file has eleven.
    let sizes = samples("h264_444");
    let both = (sizes[10].1 + sizes[11].1) as u32;
    let mut other = bytes("h264_444");
    patch(&mut other, b"stsz", 0, 8, &11u32.to_be_bytes());
    patch(&mut other, b"stsz", 0, 12 + 4 * 10, &both.to_be_bytes());
    let message = failure(&other, HEIGHT, WIDTH);
    assert!(message.contains("pictures of 11 frames"), "{message}");
}

#[test]
fn a_missing_ffmpeg_is_named_with_the_command_that_installs_it() {
    let name =
        "datasets::other_videos::a_missing_ffmpeg_is_named_with_the_command_that_installs_it";
    if !is_alone() {
        alone(name, &["env", "PATH=/nonexistent"]);
        return;
    }
    // What this program decodes itself still is.
    forwards("h264_plain", HEIGHT, WIDTH);
    let mut video = VideoReader::open(&file("hevc_hev1"), HEIGHT, WIDTH).unwrap();
    assert_eq!(video.codec().name(), "HEVC");
    let message = video.rgb(0).unwrap_err().to_string();
    assert!(
        message.ends_with("hevc_hev1.mp4: video frame 0 needs FFmpeg, which is not installed; install it: sudo apt install ffmpeg"),
        "{message}"
    );
}
