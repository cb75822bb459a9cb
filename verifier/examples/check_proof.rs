//! Checks a proof with SP1's own verifier: `check_proof PROOF CLAIM KEY`, such as `tests/fixtures/full_size/proof.bin`, `claim.bin` beside it, and
//! `circuits/elf/succinct.vk`. A claim of mode `succinct` also needs its claims about the weights checked: see `zk0_verifier::weight_claims`.

use std::error::Error;
use std::{env, fs};
use zk0_circuits::Claim;
use zk0_protocol::entries::program::ProgramKey;
use zk0_verifier::check_proof;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let [proof, claim, key] = &arguments[..] else {
        return Err("usage: check_proof PROOF CLAIM KEY".into());
    };
    let key = ProgramKey::from_bytes(&fs::read(key)?)?;
    let claim: Claim = borsh::from_slice(&fs::read(claim)?)?;
    check_proof(&fs::read(proof)?, &claim, &key)?;
    println!("the proof holds: {:#?}", claim.terms);
    println!("{:#?}", claim.losses);
    Ok(())
}
