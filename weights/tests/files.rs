//! Files of weights are read strictly: whatever is wrong with a file, the error names the tensor and the cause.

use proptest::prelude::*;
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use std::collections::HashMap;
use std::fmt::Write as _;
use zk0_circuits::{EvalSpec, QuantisedWeights};
use zk0_tensors::TensorError;
use zk0_weights::format::SCALES;
use zk0_weights::{Format, WeightFileError};

const FIRST: &str = "model.action_in_proj.weight";
const LAST: &str = "model.action_out_proj.bias";

fn format() -> Format {
    Format::new(&EvalSpec::micro()).unwrap()
}

fn weights() -> QuantisedWeights {
    let format = format();
    let values: HashMap<_, Vec<f32>> = format
        .tensors()
        .iter()
        .map(|tensor| {
            let value = |at: usize| (at * 37 % 101) as f32 / 250.0 - 0.2;
            (tensor.name.clone(), (0..tensor.len()).map(value).collect())
        })
        .collect();
    QuantisedWeights::quantise(format.spec(), |name| values.get(name).map(Vec::as_slice)).unwrap()
}

fn good() -> Vec<u8> {
    format().write(&weights())
}

fn refused(file: &[u8]) -> WeightFileError {
    format().read(file).unwrap_err()
}

/// Where the data begins.
fn data(file: &[u8]) -> usize {
    8 + u64::from_le_bytes(file[..8].try_into().unwrap()) as usize
}

/// A file's tensors: name, type, shape and data.
type Raw = Vec<(String, Dtype, Vec<usize>, Vec<u8>)>;

fn raw() -> Raw {
    let good = good();
    let file = SafeTensors::deserialize(&good).unwrap();
    let mut names: Vec<_> = file.names().into_iter().map(str::to_owned).collect();
    names.sort_by_key(|name| file.tensor(name).unwrap().data().as_ptr());
    let tensor = |name: String| {
        let view = file.tensor(&name).unwrap();
        let (shape, data) = (view.shape().to_vec(), view.data().to_vec());
        (name, view.dtype(), shape, data)
    };
    names.into_iter().map(tensor).collect()
}

/// Writes a file whose tensors lie in the order that is given.
fn file(raw: &Raw, metadata: &str) -> Vec<u8> {
    let (mut header, mut at) = (format!("{{{metadata}"), 0);
    for (name, dtype, shape, data) in raw {
        let (from, to) = (at, at + data.len());
        at = to;
        let comma = if header.len() > 1 { "," } else { "" };
        write!(header, r#"{comma}"{name}":{{"dtype":"{dtype}","shape":{shape:?},"data_offsets":[{from},{to}]}}"#).unwrap();
    }
    header.push('}');
    let header = header.replace(", ", ",");
    let padded = format!("{header:<width$}", width = header.len().next_multiple_of(8));
    let data = raw.iter().flat_map(|(_, _, _, data)| data.iter().copied());
    let length = (padded.len() as u64).to_le_bytes();
    length
        .into_iter()
        .chain(padded.into_bytes())
        .chain(data)
        .collect()
}

#[test]
fn weights_come_back_from_their_one_file() {
    let (format, weights, good) = (format(), weights(), good());
    assert_eq!(format.read(&good), Ok(weights.clone()));
    assert_eq!(good.len() as u64, format.file_bytes());
    let opened = format.open(&good[..]).unwrap();
    for index in 0..format.tensors().len() {
        let tensor = opened.tensor(index).unwrap();
        assert_eq!(
            (&tensor.values[..], tensor.bits),
            format.tensor(&weights, index)
        );
    }
    let again = format.assemble(|index| opened.tensor(index));
    assert_eq!(again, Ok(weights));
}

/// This is a test vector. A change here changes the digest of every network's weights.
#[test]
fn a_file_is_a_header_and_what_the_evaluation_reads() {
    let (good, weights) = (good(), weights());
    let header = str::from_utf8(&good[8..data(&good)]).unwrap();
    assert!(header.starts_with(
        r#"{"fraction_bits":{"dtype":"I16","shape":[27],"data_offsets":[0,54]},"model.action_in_proj.weight":{"dtype":"I16","shape":[12,8],"data_offsets":[54,246]},"model.action_in_proj.bias":{"dtype":"I16","shape":[12],"data_offsets":[246,270]},"#
    ), "{header}");
    let numbers = &good[data(&good)..];
    assert_eq!(numbers, &weights.as_bytes()[..numbers.len()]);
    assert_eq!(numbers.len().next_multiple_of(8), weights.as_bytes().len());
    // The safetensors crate reads it too, and the test's own writer writes the same.
    assert_eq!(file(&raw(), ""), good);
}

#[test]
fn every_truncation_says_so() {
    let good = good();
    for end in (0..good.len()).step_by(7).chain([good.len() - 1]) {
        let text = refused(&good[..end]).to_string();
        assert!(text.contains("truncated"), "{end}: {text}");
    }
}

#[test]
fn bytes_after_the_data_are_refused() {
    let longer = [&good()[..], &[0]].concat();
    let error = refused(&longer);
    assert!(
        matches!(error, WeightFileError::Tensor(TensorError::Length(_))),
        "{error}"
    );
}

#[test]
fn a_header_beyond_the_file_or_the_limit_is_refused() {
    let mut bytes = good();
    bytes[..8].copy_from_slice(&u64::MAX.to_le_bytes());
    let too_large = refused(&bytes);
    assert!(matches!(
        too_large,
        WeightFileError::Tensor(TensorError::HeaderTooLarge { .. })
    ));
    bytes[..8].copy_from_slice(&100_000u64.to_le_bytes());
    let truncated = refused(&bytes);
    assert!(matches!(
        truncated,
        WeightFileError::Tensor(TensorError::HeaderTruncated { .. })
    ));
}

#[test]
fn missing_and_extra_tensors_are_named() {
    for name in [SCALES, FIRST, LAST] {
        let mut raw = raw();
        raw.retain(|(own, ..)| own != name);
        let missing = TensorError::Missing(name.into());
        assert_eq!(refused(&file(&raw, "")), missing.into());
    }
    // Auditors compare the reason of a refusal, so it is the same in every process: the first extra tensor is named.
    let mut raw = raw();
    for name in ["c", "d", "e", "f", "g", "h"] {
        raw.insert(3, (name.into(), Dtype::I16, vec![1], vec![1, 0]));
    }
    for _ in 0..4 {
        assert_eq!(refused(&file(&raw, "")), WeightFileError::Extra("h".into()));
    }
}

#[test]
fn a_stranger_s_name_is_quoted_short_and_does_nothing_to_a_terminal() {
    let mut raw = raw();
    let name = format!("\u{7f}{}", "x".repeat(500));
    raw.insert(3, (name, Dtype::I16, vec![1], vec![1, 0]));
    let quoted = format!("\\u{{7f}}{}", "x".repeat(127));
    assert_eq!(refused(&file(&raw, "")), WeightFileError::Extra(quoted));
}

#[test]
fn wrong_types_and_shapes_are_named() {
    let changed = |change: &dyn Fn(&mut Dtype, &mut Vec<usize>, &mut Vec<u8>)| {
        let mut raw = raw();
        let (_, dtype, shape, data) = raw.iter_mut().find(|(name, ..)| name == FIRST).unwrap();
        change(dtype, shape, data);
        refused(&file(&raw, "")).to_string()
    };
    let reported = changed(&|dtype, _, _| *dtype = Dtype::F16);
    assert_eq!(reported, format!("tensor '{FIRST}' is F16, expected I16"));
    let reported = changed(&|_, shape, _| shape.reverse());
    assert_eq!(
        reported,
        format!("tensor '{FIRST}' has shape [8, 12], expected [12, 8]")
    );
    // What somebody gets who uploads LeRobot's float32 weights.
    let views = raw().into_iter().filter(|(name, ..)| name != SCALES);
    let views = views.map(|(name, _, shape, data)| (name, shape, [&data[..], &data[..]].concat()));
    let views: Vec<_> = views.collect();
    let views = views.iter().map(|(name, shape, data)| {
        (
            name,
            TensorView::new(Dtype::F32, shape.clone(), data).unwrap(),
        )
    });
    let reported = refused(&safetensors::serialize(views, None).unwrap()).to_string();
    assert_eq!(reported, format!("tensor '{FIRST}' is F32, expected I16"));
}

/// With a second file for the same weights, a copied update would have another digest than the one it was copied from.
#[test]
fn another_spelling_of_the_same_file_is_refused() {
    let note = file(&raw(), r#""__metadata__":{"a":"b"}"#);
    assert_eq!(refused(&note), WeightFileError::OtherHeader);
    let mut swapped = raw();
    swapped.swap(2, 4);
    assert_eq!(refused(&file(&swapped, "")), WeightFileError::OtherHeader);
    let good = good();
    let longer = (data(&good) as u64).to_le_bytes();
    let spaces = [
        &longer,
        &good[8..data(&good)],
        &[b' '; 8],
        &good[data(&good)..],
    ]
    .concat();
    assert_eq!(refused(&spaces), WeightFileError::OtherHeader);
}

#[test]
fn another_scale_of_the_same_weights_is_refused_by_name() {
    let good = good();
    let (format, at) = (format(), data(&good));
    let (values, bits) = {
        let opened = format.open(&good[..]).unwrap();
        let first = opened.tensor(0).unwrap();
        (first.values, first.bits)
    };
    // One bit less, and half the values: the same numbers where they are even.
    let mut coarser = good.clone();
    coarser[at..][..2].copy_from_slice(&(bits - 1).to_le_bytes());
    let scales = 2 * format.tensors().len();
    for (place, value) in coarser[at + scales..].chunks_exact_mut(2).zip(&values) {
        place.copy_from_slice(&(value / 2).to_le_bytes());
    }
    let error = refused(&coarser);
    assert!(
        matches!(&error, WeightFileError::CoarseScale { name, .. } if name == FIRST),
        "{error}"
    );
    let opened = format.open(&coarser[..]).unwrap();
    assert_eq!(opened.tensor(0), Err(error));
    assert!(opened.tensor(1).is_ok());

    for beyond in [-1i16, 25, i16::MIN, i16::MAX] {
        let mut changed = good.clone();
        changed[at..][..2].copy_from_slice(&beyond.to_le_bytes());
        let error = refused(&changed);
        assert!(
            matches!(&error, WeightFileError::Scale { name, bits, .. } if name == FIRST && *bits == beyond),
            "{error}"
        );
        assert_eq!(format.open(&changed[..]).err(), Some(error));
    }
}

#[test]
fn a_value_without_an_opposite_is_refused_by_name() {
    let mut bytes = good();
    let last = bytes.len() - 2;
    bytes[last..].copy_from_slice(&i16::MIN.to_le_bytes());
    let (name, index) = (LAST.to_owned(), 7);
    assert_eq!(refused(&bytes), WeightFileError::TooLarge { name, index });
}

proptest! {
    /// Quantising float32 weights gives each tensor the one scale that a file may have, also next to where the scale changes.
    #[test]
    fn whatever_is_quantised_can_be_read(steps in 16_383.0f32..32_768.5, doublings in -8i32..30, sign in prop::bool::ANY) {
        let format = format();
        let largest = if sign { steps } else { -steps } / 2f32.powi(doublings);
        let values: HashMap<_, Vec<f32>> = format.tensors().iter().map(|tensor| {
            let mut values = vec![largest / 3.0; tensor.len()];
            values[tensor.len() / 2] = largest;
            (tensor.name.clone(), values)
        }).collect();
        let get = |name: &str| values.get(name).map(Vec::as_slice);
        if let Ok(weights) = QuantisedWeights::quantise(format.spec(), get) {
            prop_assert_eq!(format.read(&format.write(&weights)), Ok(weights));
        }
    }

    #[test]
    fn no_bytes_make_it_panic(bytes in prop::collection::vec(any::<u8>(), 0..300), length in 0u64..300) {
        let _ = format().read(&bytes);
        let _ = format().read(&[&length.to_le_bytes()[..], &bytes].concat());
    }

    /// Whatever is read is written as it was: there is no second file.
    #[test]
    fn what_is_read_is_the_one_file_of_its_weights(at in any::<prop::sample::Index>(), flip in 1u8..) {
        let mut bytes = good();
        let at = at.index(bytes.len());
        bytes[at] ^= flip;
        if let Ok(weights) = format().read(&bytes) {
            prop_assert_eq!(format().write(&weights), bytes);
        }
    }
}
