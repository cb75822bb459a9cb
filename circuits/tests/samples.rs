//! A sample holds zeros where the evaluation reads nothing, so that one sample is one leaf.

use std::collections::BTreeSet;
use zk0_circuits::claim::dataset::leaf;
use zk0_circuits::model::draw::draw;
use zk0_circuits::model::eval::{evaluate, Overflow};
use zk0_circuits::model::quantise::QuantiseError;
use zk0_circuits::model::sample::{SampleError, SampleParts};
use zk0_circuits::{Digest, EvalSpec, Sample};
use zk0_testkit::claims::{honest, FloatSample, Random};

/// Its last two frames are padding.
fn parts(spec: &EvalSpec) -> FloatSample {
    FloatSample::random(spec, &mut Random(4), 9, 2)
}

#[test]
fn a_thousand_variants_of_what_is_not_read_give_one_leaf() {
    let spec = EvalSpec::micro();
    let width = spec.dims.max_action_dim as usize;
    let mut random = Random(5);
    let leaves: BTreeSet<Digest> = (0..1000)
        .map(|_| {
            let mut parts = parts(&spec);
            for (frame, actions) in parts.actions.chunks_exact_mut(width).enumerate() {
                let read = match parts.is_pad[frame] {
                    true => 0,
                    false => spec.dims.action_dim as usize,
                };
                actions[read..]
                    .iter_mut()
                    .for_each(|action| *action = random.unit());
            }
            leaf(&[7; 32], &parts.quantise(&spec).digest())
        })
        .collect();
    assert_eq!(leaves.len(), 1);
}

#[test]
fn what_is_read_changes_the_leaf() {
    let spec = EvalSpec::micro();
    let original = parts(&spec).quantise(&spec).digest();
    let changes: [fn(&mut FloatSample); 4] = [
        |parts| parts.actions[0] += 0.01,
        |parts| parts.is_pad[3] = true,
        |parts| parts.cache[1].0[5] += 0.01,
        |parts| parts.cache[0].1[5] += 0.01,
    ];
    for change in changes {
        let mut parts = parts(&spec);
        change(&mut parts);
        assert_ne!(parts.quantise(&spec).digest(), original);
    }
}

/// The bytes of a sample with another value at `at`, counted in values.
fn with(sample: &Sample, at: usize, value: i16) -> Vec<u8> {
    let mut bytes = sample.as_bytes().to_vec();
    bytes[2 * at..][..2].copy_from_slice(&value.to_le_bytes());
    bytes
}

#[test]
fn a_sample_with_a_value_that_is_not_read_is_refused() {
    let spec = EvalSpec::micro();
    let dims = &spec.dims;
    let (chunk, width) = (dims.chunk as usize, dims.max_action_dim as usize);
    let sample = parts(&spec).quantise(&spec);
    let mut read = 0;
    for frame in 0..chunk {
        for dimension in 0..width {
            let at = 1 + chunk + frame * width + dimension;
            let found = Sample::from_bytes(dims, &with(&sample, at, 9));
            match frame < chunk - 2 && dimension < dims.action_dim as usize {
                true => read += usize::from(found.is_ok()),
                false => assert_eq!(
                    found,
                    Err(SampleError::NotRead {
                        frame,
                        dimension,
                        value: 9
                    })
                ),
            }
        }
    }
    assert_eq!(read, (chunk - 2) * dims.action_dim as usize);
}

#[test]
fn padding_is_at_the_end_and_never_all_there_is() {
    let spec = EvalSpec::micro();
    let dims = &spec.dims;
    let sample = FloatSample::random(&spec, &mut Random(4), 9, 0).quantise(&spec);
    for frame in 0..dims.chunk as usize {
        let found = Sample::from_bytes(dims, &with(&sample, 1 + frame, 1)).unwrap_err();
        match frame {
            0 => assert_eq!(found, SampleError::PadOrder { frame: 0 }),
            // The last frame may be padding, but its actions are not zero.
            5 => assert!(matches!(found, SampleError::NotRead { frame: 5, .. })),
            _ => assert!(matches!(found, SampleError::NotRead { .. })),
        }
    }
    for is_pad in [[true; 6], [false, false, true, false, true, true]] {
        let mut parts = parts(&spec);
        parts.is_pad = is_pad.to_vec();
        let cache: Vec<_> = parts.cache.iter().map(|(k, v)| (&k[..], &v[..])).collect();
        let parts = SampleParts {
            cache: &cache,
            actions: &parts.actions,
            is_pad: &parts.is_pad,
        };
        assert_eq!(Sample::quantise(&spec, parts), Err(QuantiseError::PadOrder));
    }
}

#[test]
fn later_noise_changes_nothing() {
    // Attention is causal, so noise in a padded frame changes no loss.
    let spec = EvalSpec::micro();
    let honest = honest(&spec, 20, 4, 11);
    let sample = parts(&spec).quantise(&spec);
    let mut draw = draw(&spec, &Digest([6; 32]), 0, 1);
    let first = evaluate(&spec, &honest.input.base, &sample, &draw, Overflow::Refused).unwrap();
    draw.noise[5 * spec.dims.max_action_dim as usize] += 1000;
    let second = evaluate(&spec, &honest.input.base, &sample, &draw, Overflow::Refused).unwrap();
    assert_eq!(first, second);
    assert_eq!(first.elements, 4 * 6);
}
