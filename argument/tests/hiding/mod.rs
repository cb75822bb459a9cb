//! What an argument shows: nothing that depends on a sample, but for what the statement states of it.
//!
//! - [`made`]: arguments whose blinding a test chooses. [`explaining`]: another sample explains the same words.
//! - [`simulator`]: the words can be made without a sample.
//! - [`kinds`]: every kind of message needs its pads. [`words`]: two arguments of one statement. [`rank`], [`recovery`]: what opened rows show of a column.

mod explaining;
mod kinds;
mod made;
mod rank;
mod recovery;
mod simulator;
mod told_twice;
