//! Videos that are cut, contradict themselves or do not decode.

use std::fs;

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use zk0_testkit::recordings::{patch, recording, Copy, INFO, TOP};

#[test]
fn videos_that_are_cut_or_no_videos() {
    let whole = fs::read(recording("so100_pickplace").join(TOP))
        .unwrap()
        .len();
    for len in [0, 7, 20, 1000, whole / 2, whole - 1] {
        let copy = Copy::default();
        copy.edit(TOP, |bytes| bytes[..len].to_vec());
        copy.fails(TOP, "cut off");
    }
    let copy = Copy::default();
    copy.edit(TOP, |bytes| bytes.iter().map(|b| b ^ 0x5a).collect());
    copy.fails(TOP, "not an mp4");

    let copy = Copy::default();
    copy.edit(TOP, |mut bytes| {
        let at = bytes.windows(4).position(|w| w == b"av01").unwrap();
        // The first match is a brand in ftyp. The next one is the sample description.
        let at = at
            + 4
            + bytes[at + 4..]
                .windows(4)
                .position(|w| w == b"av01")
                .unwrap();
        bytes[at..at + 4].copy_from_slice(b"vp09");
        bytes
    });
    copy.fails(
        TOP,
        "codec \"vp09\", only AV1 (av01), H.264 (avc1) and HEVC (hvc1, hev1)",
    );

    let copy = Copy::default();
    copy.edit_text(INFO, "                96", "                97");
    copy.fails(
        TOP,
        "96 x 128 (height x width), meta/info.json states 97 x 128",
    );
}

#[test]
fn mp4_tables_that_contradict_themselves() {
    let big = 0x7fff_ffff_u32.to_be_bytes();
    // Each case gives the box, the offset in it, the bytes written there, and the error of the reader.
    let cases: [(&[u8; 4], usize, &[u8], &str); 14] = [
        (b"stss", 8, &big, "key frame 2147483647 does not exist"),
        (b"stss", 8, &[0; 4], "key frame 0 does not exist"),
        (b"stss", 8, &[0, 0, 0, 2], "does not begin with a key frame"),
        (b"stss", 4, &big, "a box ends too early"),
        (b"stts", 12, &[0; 4], "frame 1 is not shown after frame 0"),
        (b"stts", 8, &[0, 0, 0, 1], "a box ends too early"),
        (b"mdhd", 12, &[0; 4], "timescale of 0"),
        (b"stsz", 8, &big, "frame count 2147483647 does not fit"),
        (b"stsz", 8, &[0; 4], "frame count 0 does not fit"),
        (b"stsz", 8, &[0, 0, 0, 246], "frame count 246 does not fit"),
        (b"stsz", 12, &[0; 4], "frame 0 (0 bytes from byte "),
        (
            b"stsc",
            12,
            &[0, 0, 0, 1],
            "declares 245 frames and places 1",
        ),
        (
            b"stco",
            8,
            &big,
            "from byte 2147483647) is not within the file",
        ),
        (b"hdlr", 8, b"soun", "has no video track"),
    ];
    for (kind, skip, value, cause) in cases {
        let copy = Copy::default();
        copy.edit(TOP, |mut bytes| {
            patch(&mut bytes, kind, 0, skip, value);
            bytes
        });
        copy.fails(TOP, cause);
    }
    for (kind, name, cause) in [
        (b"udta", b"mvex", "fragmented"),
        (b"moov", b"moof", "fragmented"),
        (b"stsc", b"free", "has no stsc box"),
        (b"stco", b"free", "has no chunk offsets"),
    ] {
        let copy = Copy::default();
        copy.edit(TOP, |bytes| {
            let at = bytes.windows(4).position(|w| w == kind).unwrap();
            [&bytes[..at], name, &bytes[at + 4..]].concat()
        });
        copy.fails(TOP, cause);
    }
}

#[test]
fn boxes_that_claim_too_little_or_too_much() {
    let copy = Copy::default();
    copy.edit(TOP, |bytes| {
        [&[0, 0, 0, 1], b"free", &[0; 8][..], &bytes].concat()
    });
    copy.fails(TOP, "box \"free\" of 0 bytes");
    let copy = Copy::default();
    copy.edit(TOP, |_| {
        [&(65u32 << 20).to_be_bytes(), &b"moov"[..]].concat()
    });
    let file = fs::File::options()
        .write(true)
        .open(copy.path(TOP))
        .unwrap();
    file.set_len(65 << 20).unwrap();
    copy.fails(
        TOP,
        "index (moov) of 68157440 bytes, at most 67108864 are read",
    );
    // Frames of one byte each, as many as the file has bytes.
    let copy = Copy::default();
    copy.edit(TOP, |mut bytes| {
        patch(&mut bytes, b"stsz", 0, 4, &[0, 0, 0, 1]);
        patch(&mut bytes, b"stsz", 0, 8, &10_000_001u32.to_be_bytes());
        bytes
    });
    let file = fs::File::options()
        .write(true)
        .open(copy.path(TOP))
        .unwrap();
    file.set_len(11_000_000).unwrap();
    copy.fails(TOP, "frame count 10000001 does not fit the file");
}

#[test]
fn a_bitstream_of_another_size_than_the_container_says() {
    // The second "av01" is the sample description. Width and height are 24 bytes into it.
    let claim = |height: u8, width: u8| {
        let copy = Copy::default();
        copy.edit(TOP, |mut bytes| {
            patch(&mut bytes, b"av01", 1, 24, &[0, width, 0, height]);
            bytes
        });
        let size = |h, w| format!("[\n                {h},\n                {w},");
        copy.edit_text(INFO, &size(96, 128), &size(height, width));
        copy
    };
    // The frame is refused before it is decoded.
    claim(48, 64).fails(TOP, "video frame 0 does not decode");
    claim(128, 96).fails(
        TOP,
        "video frame 0 is 96 x 128 (height x width), expected 128 x 96",
    );
}

#[test]
fn a_video_that_does_not_decode_names_the_frame() {
    // The container stays the same, but its content is noise.
    let copy = Copy::default();
    copy.edit(TOP, |mut bytes| {
        let mdat = bytes.windows(4).position(|w| w == b"mdat").unwrap() + 4;
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        rng.fill(&mut bytes[mdat..]);
        bytes
    });
    copy.fails(TOP, "video frame 0 does not decode, as in a damaged file: ");
    let error = copy.error().to_string();
    assert!(
        error.starts_with("episode 0 frame 0, camera observation.images.top: "),
        "{error}"
    );
}
