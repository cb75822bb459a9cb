//! Tries the cheat that its argument names on the crate it was built with. Prints `accepted`, or why the claim was refused.

#[path = "mod.rs"]
mod cheats;
#[path = "../claims/mod.rs"]
mod claims;

fn main() {
    let name = std::env::args().nth(1);
    let name = name.expect("usage: cheats NAME");
    match cheats::try_cheat(&name) {
        Ok(()) => println!("accepted"),
        Err(why) => println!("refused: {why}"),
    }
}
