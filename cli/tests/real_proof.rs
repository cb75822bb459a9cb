//! A real proof, made in the run, of the smallest claim that there is: two samples of the policy `micro`. The proving service makes it, as it does
//! for a node. `make test` runs this last and alone. [`super::real_demo`] makes larger ones.

use crate::harness::process::Process;
use tokio::runtime::Runtime;
use zk0_circuits::claim::program::verifying_key;
use zk0_circuits::{EvalSpec, Mode};
use zk0_protocol::RefusalCode;
use zk0_prover::program::{synthetic, PreparedClaim};
use zk0_prover::service::ProvingClient;
use zk0_verifier::{check_proof, ProgramKey};

/// So few that no claim can have fewer.
const SAMPLES: u32 = 2;
/// The claim follows from it.
const SEED: u64 = 1;

#[test]
#[ignore = "makes a real proof: five minutes and 20 GiB of memory on two cores"]
fn a_claim_is_proven_and_its_proof_is_one_of_nothing_else() {
    let service = ["prover", "serve", "--listen", "127.0.0.1:0"].map(str::to_owned);
    let mut service = Process::start(&service);
    let listening = service.reports("the proving service listens");
    let url = format!("http://{}", listening["listening"].as_str().unwrap());
    let private = synthetic::private_input(&EvalSpec::micro(), Mode::Direct, SAMPLES, SEED);
    let (private, blind) = (private.unwrap(), synthetic::blind(SEED));
    let prepared = PreparedClaim::of(Mode::Direct, &private, &blind, None, &mut |_| {}).unwrap();
    let claim = prepared.claim;
    let proven = Runtime::new().unwrap().block_on(async {
        let address = ProvingClient::address(url);
        let mut client = ProvingClient::connect(address).await.unwrap();
        client.prove(prepared.input, |_| {}).await.unwrap()
    });
    service.terminate();
    println!(
        "{} cycles, proven in {} s",
        proven.cycles,
        proven.proving_ms / 1000
    );

    assert_eq!(proven.public_values, borsh::to_vec(&claim).unwrap());
    let [key, other_key] = [Mode::Direct, Mode::Succinct]
        .map(|mode| ProgramKey::from_bytes(&verifying_key(mode)[..]).unwrap());
    assert_eq!(check_proof(&proven.proof, &claim, &key), Ok(()));
    let mut other = claim.clone();
    other.terms.round += 1;
    let refused = check_proof(&proven.proof, &other, &key);
    assert_eq!(refused, Err(RefusalCode::OtherClaim.into()));
    let of_other_program = check_proof(&proven.proof, &claim, &other_key);
    assert_eq!(of_other_program, Err(RefusalCode::OtherProgram.into()));
    let mut changed = proven.proof;
    changed[1000] ^= 1;
    let refused = check_proof(&changed, &claim, &key);
    assert!(refused.is_err(), "a changed proof is refused");
}
