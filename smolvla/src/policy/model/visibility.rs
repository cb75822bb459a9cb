//! Who sees whom, and at which position: LeRobot's `make_att_2d_masks` and its position ids, in the two phases.
//!
//! Images and language see each other. The state token sees them and itself. An action token sees the prefix and the action
//! tokens up to itself. Tokens that are not valid (padding, absent cameras) are not seen by any token, and take no position.

/// Position of each prefix token: the running count of valid tokens, minus one.
pub fn prefix_positions(valid: &[bool]) -> Vec<i64> {
    let mut position = -1;
    valid
        .iter()
        .map(|v| {
            position += i64::from(*v);
            position
        })
        .collect()
}

/// Positions of `chunk` action tokens behind a prefix.
pub fn action_positions(valid: &[bool], chunk: usize) -> Vec<i64> {
    let start = valid.iter().filter(|v| **v).count() as i64;
    (start..start + chunk as i64).collect()
}

/// Whether token `query` of a prefix sees its token `key`, the state token being number `state`.
pub fn prefix_sees(valid: &[bool], state: usize, query: usize, key: usize) -> bool {
    valid[query] && valid[key] && (key != state || query == state)
}

/// Whether action token `query` sees `key`, where the keys are those of the prefix and then the action tokens.
pub fn action_sees(valid: &[bool], query: usize, key: usize) -> bool {
    match key.checked_sub(valid.len()) {
        None => valid[key],
        Some(action) => action <= query,
    }
}
