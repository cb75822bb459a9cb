//! Mode `checked` agrees with mode `direct`, and refuses every wrong hint.

mod claims;

use claims::{calmer, honest, quantise, tensors, Honest, Random};
use zk0_circuits::claim::hinted_input::HintedInput;
use zk0_circuits::claim::statement::{check, check_hinted};
use zk0_circuits::claim::statement_error::StatementError;
use zk0_circuits::model::site::EvalError;
use zk0_circuits::model::spec::Dims;
use zk0_circuits::{Claim, Digest, EvalSpec, Losses, NodeId, Sample, WeightCheck};

fn micro() -> (Honest, HintedInput<'static>) {
    let honest = honest(&EvalSpec::micro(), 6, 4, 1);
    let hinted = HintedInput::of(&honest.input).unwrap();
    (honest, hinted)
}

/// Returns what the verifier, who holds the weights, expects of a claim whose coefficients come from `seed`.
fn expected(honest: &Honest, seed: Digest) -> WeightCheck {
    let mut again = HintedInput::of(&honest.input).unwrap();
    let weights = [&honest.input.base, &honest.input.update];
    again.project(seed, weights).unwrap();
    let check = again.weight_check();
    assert_eq!(check.seed, seed);
    check
}

/// Whether a verifier would accept: the statement holds, and its weights are those of the files.
fn accepted(honest: &Honest, input: &HintedInput) -> Result<Claim, String> {
    let claim = check_hinted(input).map_err(|error| error.to_string())?;
    let check = input.weight_check();
    match claim.weight_check == Some(check.digest()) && check == expected(honest, check.seed) {
        true => Ok(claim),
        false => Err("the verifier finds other weights".into()),
    }
}

#[test]
fn agrees_with_direct_on_a_thousand_small_models() {
    let mut random = Random(5);
    let mut pick = |from: u32, to: u32| from + random.bits() as u32 % (to - from + 1);
    let mut evaluated = 0;
    for seed in 0.. {
        let (kv_heads, group) = (pick(1, 2), pick(1, 3));
        let max_action_dim = pick(1, 5);
        let dims = Dims {
            expert_width: 2 * pick(1, 5),
            expert_mlp: pick(1, 9),
            heads: kv_heads * group,
            kv_heads,
            head_dim: 2 * pick(1, 3),
            layers: pick(1, 3),
            self_attn_every: pick(1, 2),
            chunk: pick(3, 5),
            max_action_dim,
            action_dim: pick(1, max_action_dim),
            max_prefix: pick(2, 6),
        };
        let input = honest(&EvalSpec::new(dims), 3, 2, seed).input;
        // Sometimes the calmer copy of a random model is not better. Then both modes refuse the claim.
        let direct = check(&input);
        let hinted = HintedInput::of(&input).unwrap();
        let buffers = hinted.to_buffers();
        let read = HintedInput::from_buffers(&buffers).unwrap();
        assert_eq!(read, hinted);
        let checked = check_hinted(&read).map(|claim| Claim {
            weight_check: None,
            ..claim
        });
        assert_eq!(checked, direct, "seed {seed}, {dims:?}");
        evaluated += 1;
        if evaluated == 1000 {
            break;
        }
    }
}

#[test]
fn an_honest_claim_is_accepted() {
    let (honest, hinted) = micro();
    let claim = accepted(&honest, &hinted).unwrap();
    assert_eq!(claim.losses, check(&honest.input).unwrap().losses);
    assert!(matches!(claim.losses, Losses::Disclosed { .. }));
}

/// Changes every hinted sum in turn. The cheat draws the seed again from the hints, as the protocol does. A careless cheat keeps
/// the seed.
#[test]
fn no_hinted_product_can_be_changed() {
    let honest = honest(&EvalSpec::micro(), 3, 1, 1);
    let hinted = HintedInput::of(&honest.input).unwrap();
    let weights = [&honest.input.base, &honest.input.update];
    let mut random = Random(9);
    for model in 0..2 {
        let count = hinted.base.hints[0].sums().len();
        for index in 0..count {
            let mut cheat = hinted.clone();
            let hints = match model {
                0 => &mut cheat.base.hints[0],
                _ => &mut cheat.update.hints[0],
            };
            let sum = &mut hints.sums_mut()[index];
            // Half of the changes are as small as possible. The other half are arbitrary.
            let by = match random.bits() % 4 {
                0 => 1,
                1 => -1,
                _ => (random.bits() as i32) | 1,
            };
            *sum = sum.wrapping_add(by);
            if index % 50 == 0 {
                assert!(matches!(
                    check_hinted(&cheat),
                    Err(StatementError::Seed { .. })
                ));
            }
            cheat.seal(weights).unwrap();
            match check_hinted(&cheat) {
                Err(StatementError::Eval { .. }) => {}
                other => panic!("sum {index} of model {model} changed by {by}: {other:?}"),
            }
        }
    }
}

#[test]
fn hints_too_few_or_too_many_are_refused() {
    let (honest, hinted) = micro();
    let weights = [&honest.input.base, &honest.input.update];
    for change in [-2i64, 2] {
        let mut cheat = hinted.clone();
        let mut sums = cheat.update.hints[1].sums().to_vec();
        sums.resize((sums.len() as i64 + change) as usize, 0);
        cheat.update.hints[1] = zk0_circuits::freivalds::hints::Hints::new(&sums);
        cheat.seal(weights).unwrap();
        assert!(matches!(
            check_hinted(&cheat),
            Err(StatementError::Eval {
                error: EvalError::Hints(_),
                ..
            })
        ));
    }
    let mut cheat = hinted.clone();
    cheat.base.hints.pop();
    cheat.seal(weights).unwrap();
    assert!(check_hinted(&cheat).is_err());
}

/// The seed is not drawn from the projections. They follow from it, and the verifier recomputes them.
#[test]
fn no_projection_can_be_changed() {
    let (honest, hinted) = micro();
    let count = hinted.base.projections.len();
    for model in 0..2 {
        for index in (model..count).step_by(5) {
            let mut cheat = hinted.clone();
            let weights = match model {
                0 => &mut cheat.base,
                _ => &mut cheat.update,
            };
            weights.projections.to_mut()[index] ^= 1 << (index % 36);
            assert!(accepted(&honest, &cheat).is_err(), "limb {index}");
        }
    }
    // With the modulus added, a field element stays the same number. The digest tells the two representations apart.
    let mut cheat = hinted.clone();
    let element = &mut cheat.update.projections.to_mut()[..3];
    element[2] += 1 << 35;
    element[0] = element[0].wrapping_sub(1);
    assert!(accepted(&honest, &cheat).is_err());
}

/// The products belong to other weights than those of the file. They are consistent with one another, but the verifier refuses
/// them.
#[test]
fn hints_of_other_weights_are_refused() {
    let spec = EvalSpec::micro();
    let (honest, _) = micro();
    let other = tensors(&spec, &mut Random(77), 1.0);
    let mut cheat = honest.input.clone();
    cheat.update = quantise(&spec, &calmer(&other));
    let hinted = HintedInput::of(&cheat).unwrap();
    if let Ok(claim) = check_hinted(&hinted) {
        let check = hinted.weight_check();
        assert_eq!(claim.weight_check, Some(check.digest()));
        assert_ne!(check, expected(&honest, check.seed));
        assert_eq!(check.base, expected(&honest, check.seed).base);
    }
    assert!(accepted(&honest, &hinted).is_err());
}

#[test]
fn no_gain_or_bias_can_be_changed() {
    let (honest, hinted) = micro();
    let bytes = hinted.update.parameters.as_bytes().to_vec();
    let spec = &hinted.header.spec;
    for at in (0..bytes.len()).step_by(3) {
        let mut changed = bytes.clone();
        changed[at] ^= 1;
        let Ok(parameters) =
            zk0_circuits::model::parameters::Parameters::from_bytes(spec, &changed)
        else {
            continue; // The scale is out of bounds, or this is padding
        };
        let mut cheat = hinted.clone();
        cheat.update.parameters = parameters;
        assert!(accepted(&honest, &cheat).is_err(), "byte {at}");
        cheat
            .seal([&honest.input.base, &honest.input.update])
            .unwrap();
        assert!(accepted(&honest, &cheat).is_err(), "byte {at}, sealed anew");
    }
}

#[test]
fn no_header_field_can_be_changed() {
    let (_, hinted) = micro();
    type Change = fn(&mut HintedInput);
    let changes: [Change; 15] = [
        |w| w.header.terms.network.0[0] ^= 1,
        |w| w.header.terms.round += 1,
        |w| w.header.terms.node = NodeId([3; 32]),
        |w| w.header.terms.dataset.root.0[0] ^= 1,
        |w| w.header.terms.dataset.feature_spec.0[0] ^= 1,
        |w| w.header.terms.dataset.salt_commitment.0[0] ^= 1,
        |w| w.header.terms.evaluation.0[0] ^= 1,
        |w| w.header.terms.base.blob.0[0] ^= 1,
        |w| w.header.terms.base.quantised.0[0] ^= 1,
        |w| w.header.terms.update.blob.0[0] ^= 1,
        |w| w.header.terms.update.quantised.0[0] ^= 1,
        |w| w.header.terms.challenge.0[0] ^= 1,
        |w| w.header.terms.test.min_improvement_bps -= 1,
        |w| w.header.salt[0] ^= 1,
        |w| w.seed.0[31] ^= 1,
    ];
    for (index, change) in changes.iter().enumerate() {
        let mut cheat = hinted.clone();
        change(&mut cheat);
        assert!(check_hinted(&cheat).is_err(), "change {index} is accepted");
    }
}

#[test]
fn no_sample_index_or_path_can_be_changed() {
    let (honest, hinted) = micro();
    let weights = [&honest.input.base, &honest.input.update];
    type Change = fn(&mut HintedInput, &Honest);
    let changes: [Change; 5] = [
        |w, _| w.openings[0].index ^= 1,
        |w, _| w.openings[0].path[0].0[5] ^= 1,
        |w, h| w.openings[1].sample = h.dataset[w.openings[0].index as usize].clone(),
        |w, _| w.openings.swap(0, 1),
        |w, _| drop(w.openings.pop()),
    ];
    for (index, change) in changes.iter().enumerate() {
        let mut cheat = hinted.clone();
        change(&mut cheat, &honest);
        assert!(check_hinted(&cheat).is_err(), "change {index}");
        cheat.seal(weights).unwrap();
        assert!(check_hinted(&cheat).is_err(), "change {index}, sealed anew");
    }
}

/// Changes the values of a sample: the frozen prefix's keys and values, the actions and the padding.
#[test]
fn no_value_of_a_sample_can_be_changed() {
    let (honest, hinted) = micro();
    let weights = [&honest.input.base, &honest.input.update];
    let bytes = hinted.openings[0].sample.as_bytes().to_vec();
    let mut evaluated = 0;
    for at in (0..bytes.len()).step_by(2) {
        let mut changed = bytes.clone();
        changed[at] ^= 1;
        let Ok((sample, _)) = Sample::split_from(&hinted.header.spec.dims, &changed) else {
            // The prefix has another length, or the padding is neither 0 nor 1.
            continue;
        };
        let mut cheat = hinted.clone();
        cheat.openings[0].sample = sample;
        assert!(check_hinted(&cheat).is_err(), "byte {at}");
        cheat.seal(weights).unwrap();
        assert!(check_hinted(&cheat).is_err(), "byte {at}, sealed anew");
        evaluated += 1;
    }
    assert!(evaluated > 400, "only {evaluated} values could be changed");
}

/// The noise and the flow times are drawn, not hinted. Products of another challenge do not fit.
#[test]
fn products_under_other_noise_are_refused() {
    let (honest, hinted) = micro();
    let mut other = honest.input.clone();
    other.header.terms.challenge.0[0] ^= 1;
    let other = HintedInput::of(&other).unwrap();
    let mut cheat = hinted.clone();
    cheat.update.hints = other.update.hints;
    cheat
        .seal([&honest.input.base, &honest.input.update])
        .unwrap();
    assert!(matches!(
        check_hinted(&cheat),
        Err(StatementError::Eval { .. })
    ));
}

#[test]
fn truncated_buffers_are_refused() {
    let (_, hinted) = micro();
    let honest = hinted.to_buffers();
    for buffer in 0..honest.len() {
        for keep in [0, 1, honest[buffer].len() / 2, honest[buffer].len() - 1] {
            let mut buffers = honest.clone();
            buffers[buffer].truncate(keep);
            let read = HintedInput::from_buffers(&buffers);
            let refused = match &read {
                Ok(input) => check_hinted(input).is_err(),
                Err(_) => true,
            };
            assert!(refused, "buffer {buffer} cut to {keep} bytes");
        }
    }
    assert!(HintedInput::from_buffers(&honest[..3]).is_err());
    assert!(HintedInput::from_buffers(&honest[..honest.len() - 1]).is_err());
}
