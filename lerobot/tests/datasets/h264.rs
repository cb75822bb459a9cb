//! The pictures that come out of an mp4 are those of the H.264 stream in it, and those that FFmpeg decodes.

use std::fs;
use std::path::Path;

use openh264::decoder::Decoder;
use openh264::encoder::Profile;
use openh264::formats::YUVSource;
use zk0_lerobot::dataset::{
    rgb_from_yuv, ColorMatrix, Colors, Sampling, VideoReader, Yuv, YuvFormat,
};
use zk0_testkit::recordings::mp4_writer::{encode, EncodedVideo};
use zk0_testkit::recordings::{fixtures, frames, open, patch, Copy};

const HEIGHT: usize = 96;
const WIDTH: usize = 128;

/// Makes pictures of a bright disc that moves over a gradient, as RGB.
fn film(frames: usize) -> Vec<Vec<u8>> {
    let picture = |n: usize| {
        let pixel = |channel: usize, row: usize, column: usize| {
            let (dy, dx) = (row as i32 - 48, column as i32 - 20 - 2 * n as i32);
            match dy * dy + dx * dx < 300 {
                true => [230, 60, 90][channel],
                false => (row + column / 2 + 40 * channel) as u8,
            }
        };
        let mut rgb = Vec::with_capacity(3 * HEIGHT * WIDTH);
        for channel in 0..3 {
            for row in 0..HEIGHT {
                rgb.extend((0..WIDTH).map(|column| pixel(channel, row, column)));
            }
        }
        rgb
    };
    (0..frames).map(picture).collect()
}

/// Peak signal-to-noise ratio in dB.
fn psnr(a: &[u8], b: &[u8]) -> f64 {
    assert_eq!(a.len(), b.len());
    let squares = a
        .iter()
        .zip(b)
        .map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2));
    10.0 * (255.0f64.powi(2) * a.len() as f64 / squares.sum::<f64>().max(1e-9)).log10()
}

/// Decodes the pictures of the raw byte stream without any container.
fn decoded_directly(stream: &EncodedVideo) -> Vec<Vec<u8>> {
    let mut decoder = Decoder::new().unwrap();
    let mut pictures = Vec::new();
    for bytes in &stream.annex_b {
        let yuv = decoder.decode(bytes).unwrap().unwrap();
        let (y_stride, uv_stride, _) = yuv.strides();
        let picture = Yuv {
            format: YuvFormat {
                sampling: Sampling::Yuv420,
                bits: 8,
                colors: Colors {
                    matrix: ColorMatrix::Bt601,
                    full_range: false,
                },
            },
            y: yuv.y(),
            u: yuv.u(),
            v: yuv.v(),
            y_stride,
            uv_stride,
            height: HEIGHT,
            width: WIDTH,
        };
        pictures.push(rgb_from_yuv(&picture).unwrap());
    }
    pictures
}

fn reader(dir: &Path, mp4: &[u8]) -> VideoReader {
    let path = dir.join("video.mp4");
    fs::write(&path, mp4).unwrap();
    VideoReader::open(&path, HEIGHT, WIDTH).unwrap()
}

fn failure(mp4: &[u8]) -> String {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("video.mp4");
    fs::write(&path, mp4).unwrap();
    let read = VideoReader::open(&path, HEIGHT, WIDTH)
        .and_then(|mut video| (0..video.len()).try_for_each(|n| video.rgb(n).map(drop)));
    let message = read.expect_err("nothing was wrong").to_string();
    assert!(message.contains("video.mp4: "), "{message}");
    message
}

#[test]
fn pictures_in_an_mp4_are_those_of_the_stream() {
    let film = film(40);
    let dir = tempfile::tempdir().unwrap();
    for profile in [Profile::Baseline, Profile::Main, Profile::High] {
        let stream = encode(&film, HEIGHT, WIDTH, profile, 10);
        assert_eq!(stream.pictures.iter().filter(|p| p.key).count(), 4);
        let direct = decoded_directly(&stream);
        let mut video = reader(dir.path(), &stream.mp4(HEIGHT, WIDTH));
        assert_eq!(
            (video.len(), video.codec().name(), video.key_frames()),
            (40, "H.264", 4)
        );
        for (n, like) in direct.iter().enumerate() {
            assert_eq!(video.frame_at(n as f64 / 30.0, 1e-4).unwrap(), n);
            assert!(&video.rgb(n).unwrap() == like, "{profile:?} {n}");
            assert!(
                psnr(like, &film[n]) > 28.0,
                "{profile:?} {n}: {}",
                psnr(like, &film[n])
            );
        }
        // The test reads backwards and in leaps, so decoding begins at key frames.
        for n in (0..40).rev().step_by(7).chain([5, 25, 26, 24, 0]) {
            assert!(video.rgb(n).unwrap() == direct[n], "{profile:?} {n}");
        }
    }
}

/// Compares with pictures of libx264's films as PyAV decodes them. The films have B-frames, references in both directions and long
/// distances between key frames. `tests/fixtures/videos/make.py` makes them.
#[test]
fn b_frames_and_edit_lists_are_read_as_ffmpeg_reads_them() {
    for name in [
        "h264_bframes",
        "h264_opengop",
        "h264_longgop",
        "h264_baseline",
    ] {
        let path = fixtures().join(format!("videos/{name}.mp4"));
        let like = fs::read(fixtures().join(format!("videos/{name}.rgb"))).unwrap();
        let like: Vec<&[u8]> = like.chunks_exact(3 * 32 * 48).collect();
        let mut video = VideoReader::open(&path, 32, 48).unwrap();
        assert_eq!(video.len(), like.len(), "{name}");
        for n in 0..like.len() {
            assert_eq!(video.frame_at(n as f64 / 30.0, 1e-4).unwrap(), n, "{name}");
        }
        let differ: Vec<(usize, u64)> = (0..like.len())
            .map(|n| (n, psnr(&video.rgb(n).unwrap(), like[n]) as u64))
            .filter(|(_, likeness)| *likeness < 100)
            .collect();
        // In one of these pictures, OpenH264 differs from FFmpeg by one level here and there.
        match name {
            "h264_opengop" => assert!(
                differ.len() <= 1 && differ.iter().all(|(_, psnr)| *psnr >= 60),
                "{differ:?}"
            ),
            _ => assert!(differ.is_empty(), "{name}: {differ:?} (frame, PSNR)"),
        }
        let forwards: Vec<Vec<u8>> = (0..like.len()).map(|n| video.rgb(n).unwrap()).collect();
        for n in (0..like.len()).rev().step_by(5) {
            assert!(video.rgb(n).unwrap() == forwards[n], "{name} {n}");
        }
    }
}

#[test]
fn a_recording_in_h264_gives_the_same_frames() {
    let like = open("so100_pickplace_v21");
    let copy = Copy::of("so100_pickplace_v21");
    let likes: Vec<_> = frames(&like, 10).map(Result::unwrap).collect();
    for episode in like.episodes() {
        for (camera, span) in episode.videos.iter().enumerate() {
            let pictures: Vec<Vec<u8>> = likes[episode.frames.clone()]
                .iter()
                .map(|f| f.images[camera].pixels.clone())
                .collect();
            let stream = encode(&pictures, HEIGHT, WIDTH, Profile::High, 12);
            let path = &span.as_ref().unwrap().path;
            let file = path.strip_prefix(like.root()).unwrap();
            fs::write(copy.root().join(file), stream.mp4(HEIGHT, WIDTH)).unwrap();
        }
    }
    let ours = copy.open().unwrap();
    for (found, like) in frames(&ours, 10).zip(&likes) {
        let found = found.unwrap();
        for (a, b) in found.images.iter().zip(&like.images) {
            let likeness = psnr(&a.pixels, &b.pixels);
            assert!(likeness > 25.0, "frame {}: {likeness}", like.index);
        }
        assert_eq!(found.actions, like.actions);
    }
}

#[test]
fn what_the_container_says_is_checked_against_the_stream() {
    let stream = encode(&film(12), HEIGHT, WIDTH, Profile::High, 6);
    let mp4 = stream.mp4(HEIGHT, WIDTH);

    // The sample description has another width and height than the stream.
    let mut other = mp4.clone();
    patch(&mut other, b"avc1", 1, 24, &[0, 64]);
    assert!(failure(&other).contains("pictures are 96 x 64"));
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("video.mp4");
    patch(&mut other, b"avc1", 1, 24, &[0, 64, 0, 48]);
    fs::write(&path, &other).unwrap();
    let error = VideoReader::open(&path, 48, 64)
        .unwrap()
        .rgb(0)
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("video frame 0 is 96 x 128 (height x width), expected 48 x 64"),
        "{error}"
    );

    // These cases change the configuration: its version, the size of lengths and the number of parameter sets. After them, the
    // configuration is missing.
    for (skip, value, cause) in [
        (0, &[2][..], "(avcC) of version 2"),
        (4, &[0xfe], "lengths of 3 bytes"),
        (5, &[0xff], "a box ends too early"),
        (6, &[0xff, 0xff], "a box ends too early"),
        (5, &[0xe0], "video frame 0 does not decode"),
        (4, &[0xfc], "video frame 0 "),
        (4, &[0xfd], "video frame 0 "),
        (12, &[0xff; 8], "video frame 0 "),
    ] {
        let mut other = mp4.clone();
        patch(&mut other, b"avcC", 0, skip, value);
        let message = failure(&other);
        assert!(message.contains(cause), "{skip} {value:?}: {message}");
    }
    let mut other = mp4.clone();
    patch(&mut other, b"elst", 0, 12, &(-2i32).to_be_bytes());
    assert!(failure(&other).contains("has an edit list that is not understood"));
    let mut other = mp4.clone();
    let at = other.windows(4).position(|w| w == b"avcC").unwrap();
    other[at..at + 4].copy_from_slice(b"free");
    assert!(failure(&other).contains("has no avcC box"));

    // In the first file, the length of a picture is wrong. In the second, a picture is noise.
    let mdat = mp4.windows(4).position(|w| w == b"mdat").unwrap() + 4;
    let mut other = mp4.clone();
    other[mdat..mdat + 4].copy_from_slice(&[0, 0, 0xff, 0xff]);
    assert!(failure(&other).contains("video frame 0 holds a NAL unit that is longer"));
    let mut other = mp4.clone();
    other[mdat + 8..mdat + 200].fill(0x5a);
    assert!(failure(&other).contains("video frame 0 does not decode"));
}

#[test]
fn frames_shown_out_of_order_are_found_by_their_times() {
    // Pictures that do not depend on one another can be shown in any order.
    let film = film(24);
    let stream = encode(&film, HEIGHT, WIDTH, Profile::High, 1);
    let direct = decoded_directly(&stream);
    let shown: Vec<u32> = (0..24)
        .map(|i| i / 4 * 4 + [2, 0, 3, 1][i as usize % 4])
        .collect();
    let dir = tempfile::tempdir().unwrap();
    let mut video = reader(dir.path(), &stream.mp4_shown(HEIGHT, WIDTH, &shown));
    for (decoded, &number) in shown.iter().enumerate() {
        assert_eq!(
            video.frame_at(f64::from(number) / 30.0, 1e-4).unwrap(),
            number as usize
        );
        assert!(
            video.rgb(number as usize).unwrap() == direct[decoded],
            "{number}"
        );
    }

    // No decoder keeps as many pictures as this order needs: all depend on one key frame, and the last one is shown first.
    let long = encode(&film, HEIGHT, WIDTH, Profile::High, 30);
    let backwards: Vec<u32> = (0..24).rev().collect();
    assert!(failure(&long.mp4_shown(HEIGHT, WIDTH, &backwards)).contains("shown long before"));
    let twice: Vec<u32> = (0..24).map(|i| i / 2).collect();
    assert!(failure(&long.mp4_shown(HEIGHT, WIDTH, &twice)).contains("is not shown after frame"));
}

#[test]
fn pictures_that_were_decoded_ahead_are_kept_until_their_time_alone() {
    // Every second picture is decoded before the one that is shown before it.
    let stream = encode(&film(48), HEIGHT, WIDTH, Profile::High, 60);
    let shown: Vec<u32> = (0..48)
        .map(|i| {
            if i == 0 || i == 47 {
                i
            } else {
                i + i % 2 * 2 - 1
            }
        })
        .collect();
    let dir = tempfile::tempdir().unwrap();
    let mut video = reader(dir.path(), &stream.mp4_shown(HEIGHT, WIDTH, &shown));
    for number in (1..48).step_by(2) {
        video.rgb(number).unwrap();
    }
}
