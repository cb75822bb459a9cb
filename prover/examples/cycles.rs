//! Prints what claims cost, one JSON line per profile and mode: `cargo run --release -p zk0-prover --example cycles`.

use std::error::Error;

#[tokio::main]
async fn main() -> Result<(), Box<dyn Error>> {
    for cost in zk0_prover::cycles::measure().await? {
        println!("{}", serde_json::to_string(&cost)?);
    }
    Ok(())
}
