//! The readers that are given random bytes, and the inputs that fuzzing starts from.

use prost::Message as _;
use zk0_circuits::{EvalSpec, Mode};
use zk0_prover::program::synthetic::{blind, private_input};
use zk0_prover::program::{GuestInput, PreparedClaim};
use zk0_prover::rpc::ProvePart;
use zk0_prover::service::upload::{parts, Announced};
use zk0_testkit::fuzzing::{Target, Targets};

pub const TARGETS: Targets = Targets {
    names: &NAMES,
    target,
    // An evaluation has tables.
    slack: 2 << 20,
};

const NAMES: [&str; 2] = ["guest_input", "prove_request"];

fn target(name: &str) -> Target {
    match name {
        "guest_input" => Target {
            seeds: inputs().map(framed_input).into(),
            run: Box::new(|bytes| {
                let (mode, buffers) = bytes.split_first().ok_or("no bytes at all")?;
                let mode = match mode {
                    0 => Mode::Direct,
                    _ => Mode::Succinct,
                };
                let buffers = unframed(buffers);
                let claim = GuestInput::new(mode, buffers).claim();
                claim
                    .map(drop)
                    .map_err(|error| without_parts(error.to_string()))
            }),
        },
        "prove_request" => prove_request(),
        other => panic!("no target {other}; there are {NAMES:?}"),
    }
}

/// Returns one outcome for messages that the verifier's target `eval_spec` tells apart.
fn without_parts(message: String) -> String {
    let parts =
        ["scale", "dimension"].map(|part| format!("the private input cannot be read: {part}"));
    let part = parts.into_iter().find(|part| message.starts_with(part));
    part.unwrap_or(message)
}

/// Inputs of true claims, one for each program.
fn inputs() -> [GuestInput; 2] {
    Mode::ALL.map(|mode| {
        let input = private_input(&EvalSpec::micro(), mode, 2, 1).unwrap();
        let prepared = PreparedClaim::of(mode, &input, &blind(1), None, &mut |_| {});
        prepared.unwrap().input
    })
}

fn framed_input(input: GuestInput) -> Vec<u8> {
    let mode = match input.mode {
        Mode::Direct => 0,
        Mode::Succinct => 1,
    };
    [vec![mode], framed(&input.buffers)].concat()
}

/// Joins the parts, each after its length.
fn framed(parts: &[Vec<u8>]) -> Vec<u8> {
    let framed = parts
        .iter()
        .map(|part| [&(part.len() as u32).to_le_bytes()[..], part].concat());
    framed.collect::<Vec<_>>().concat()
}

/// Splits what [`framed`] joined. A length beyond the end means all that is left.
fn unframed(mut bytes: &[u8]) -> Vec<Vec<u8>> {
    let mut parts = Vec::new();
    while let Some((length, rest)) = bytes.split_first_chunk::<4>() {
        let length = u32::from_le_bytes(*length) as usize;
        let (part, rest) = rest.split_at(length.min(rest.len()));
        parts.push(part.to_vec());
        bytes = rest;
    }
    parts
}

/// Reads the messages in which a guest input arrives.
fn prove_request() -> Target {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .build()
        .unwrap();
    let small = |mode| GuestInput::new(mode, vec![b"head".to_vec(), vec![], vec![7; 300]]);
    let seeds = Mode::ALL.map(|mode| {
        let parts: Vec<Vec<u8>> = parts(small(mode)).map(|p| p.encode_to_vec()).collect();
        framed(&parts)
    });
    Target {
        seeds: seeds.into(),
        run: Box::new(move |bytes| {
            let parts = unframed(bytes);
            let parts = parts.iter().map(|part| {
                ProvePart::decode(&part[..])
                    .map_err(|error| tonic::Status::internal(error.to_string()))
            });
            let mut parts = tokio_stream::iter(parts.collect::<Vec<_>>());
            let received = runtime.block_on(async {
                let announced = Announced::receive(&mut parts).await?;
                announced.rest(&mut parts).await
            });
            received
                .map(drop)
                .map_err(|status| status.message().to_owned())
        }),
    }
}
